"""Test the metadata and the files of the distributions, and that files of the project agree on them."""

import importlib
import importlib.metadata
import json
import re
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

import dfd
from dfd.common import distribution
from dfd.common.distribution import DISTRIBUTION

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
sys.path.append(str(ROOT / "tests" / "wheel"))
release = importlib.import_module("release")


def test_the_distribution_has_one_name():
    assert PROJECT["project"]["name"] == DISTRIBUTION
    extras = str(PROJECT["project"]["optional-dependencies"])
    assert set(re.findall(r"'([^'>]+)\[app", extras)) == {DISTRIBUTION}


def test_no_page_promises_a_release_that_does_not_exist():
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        assert not re.search(rf'pip install "?{DISTRIBUTION}\b', page.read_text("utf-8")), page


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, 'pip install "dfd[app]"'),
        ({"url": "file:///home/me/dfd", "dir_info": {}}, 'pip install "dfd[app] @ file:///home/me/dfd"'),
        ({"url": "file:///home/me/dfd", "dir_info": {"editable": True}}, 'pip install -e "/home/me/dfd[app]"'),
        (
            {"url": "https://example.org/dfd", "vcs_info": {"vcs": "git", "commit_id": "1a2b"}},
            'pip install "dfd[app] @ git+https://example.org/dfd@1a2b"',
        ),
    ],
)
def test_an_extra_is_installed_from_where_the_package_came_from(monkeypatch, origin, command):
    found = SimpleNamespace(read_text=lambda _: None if origin is None else json.dumps(origin))
    monkeypatch.setattr(distribution, "distribution", lambda _: found)
    assert distribution.pip_install("app") == command


def test_a_session_cannot_be_shown_without_the_extra(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("dfd.app.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    with pytest.raises(ImportError, match=re.escape(f"(uvicorn): {distribution.pip_install('app')}")):
        dfd.Deformer.page(None)


def test_the_package_knows_its_version():
    assert dfd.__version__ == importlib.metadata.version(PROJECT["project"]["name"])


def test_the_changelog_has_the_version():
    assert f"## [{PROJECT['project']['version']}]" in (ROOT / "CHANGELOG.md").read_text("utf-8")


def test_every_library_in_the_page_has_a_notice():
    client = json.loads((ROOT / "python/dfd/app/client/package.json").read_text("utf-8"))
    notices = (ROOT / "THIRD_PARTY.md").read_text("utf-8")
    assert all(re.search(rf"^- {name}\b.*Copyright", notices, re.MULTILINE) for name in client["dependencies"])


def test_every_folder_with_learned_numbers_has_a_notice():
    folders = {path.parent for path in (ROOT / "python/dfd").rglob("*.safetensors")} | {
        ROOT / "python/dfd/segmentation"
    }
    notices = (ROOT / "THIRD_PARTY.md").read_text("utf-8")
    assert [folder for folder in folders if f"`{folder.relative_to(ROOT / 'python')}`" not in notices] == []


def test_the_lowest_python_is_the_same_everywhere():
    lowest = PROJECT["project"]["requires-python"].removeprefix(">=")
    tag = f"cp{lowest.replace('.', '')}"
    assert PROJECT["tool"]["scikit-build"]["wheel"]["py-api"] == tag
    assert PROJECT["tool"]["cibuildwheel"]["build"] == f"{tag}-*"
    assert f"find_package(Python {lowest} " in (ROOT / "cpp/bindings/CMakeLists.txt").read_text("utf-8")
    for page in ("README.md", "CONTRIBUTING.md", "docs/start.md"):
        assert set(re.findall(r"Python ≥ ([\d.]+\d)", (ROOT / page).read_text("utf-8"))) == {lowest}
    assert f'"{lowest}"' in (ROOT / ".github/workflows/test.yml").read_text("utf-8")


def test_links_of_the_readme_lead_to_the_repository_on_the_index():
    text = release.with_address((ROOT / "README.md").read_text("utf-8"), "https://example.org/dfd", "1.2")
    links = re.findall(r"\]\(([^)]+)\)", text)
    assert links
    assert [link for link in links if not link.startswith(("https://", "#"))] == []
    assert "](https://example.org/dfd/raw/v1.2/docs/opening.png)" in text
    assert "](https://example.org/dfd/blob/v1.2/docs/start.md)" in text


@pytest.mark.processes
def test_the_source_distribution_has_what_its_build_and_its_tests_read(tmp_path):
    build = "import sys, scikit_build_core.build as b; print(b.build_sdist(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", build, tmp_path], cwd=ROOT, check=True, capture_output=True, text=True)
    with tarfile.open(tmp_path / done.stdout.split()[-1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
        [head] = [each for each in archive.getnames() if each.count("/") == 1 and each.endswith("PKG-INFO")]
        metadata = archive.extractfile(head).read().decode()
    needed = {"LICENSE", "THIRD_PARTY.md", "CHANGELOG.md", "docs/learned.md", "docs/index.md", ".ci/run", "Makefile"}
    needed |= {"tests/python/test_pages.py", "tests/wheel/smoke.py", "cpp/dfd/CMakeLists.txt"}
    if (ROOT / "python/dfd/app/static/index.html").is_file():
        needed.add("python/dfd/app/static/index.html")
    assert needed <= names
    assert not [name for name in names if "node_modules" in name or name.startswith("build/")]
    for line in ("License-Expression: MIT", "License-File: THIRD_PARTY.md", "License-File: docs/learned.md"):
        assert f"{line}\n" in metadata


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """Return a function that makes a repository of a version with these files, for which a release is then tried."""

    def make(**files):
        files = {"pyproject.toml": '[project]\nversion = "1.2.3"\n', "CHANGELOG.md": "## [1.2.3] - today\n", **files}
        for name, text in files.items():
            (tmp_path / name).write_text(text, "utf-8")
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        for command in (("init", "-q"), ("add", "-A"), (*who, "commit", "-q", "-m", "all")):
            subprocess.run(["git", *command], cwd=tmp_path, check=True)
        monkeypatch.setattr(release, "ROOT", tmp_path)
        monkeypatch.setattr(importlib.import_module("everywhere"), "ROOT", tmp_path)
        monkeypatch.delenv("GITHUB_REF_TYPE", raising=False)
        return tmp_path

    return make


def test_a_clean_tree_with_its_version_in_the_changelog_can_be_released(repository):
    repository()
    assert release.checked_version() == "1.2.3"


@pytest.mark.parametrize(
    ("files", "changed", "message"),
    [
        ({}, {"new.py": ""}, "changes that are not committed"),
        ({"CHANGELOG.md": "## [1.2.30]\n"}, {}, r"CHANGELOG.md has no section \[1.2.3\]"),
    ],
)
def test_other_trees_are_not_released(repository, files, changed, message):
    root = repository(**files)
    for name, text in changed.items():
        (root / name).write_text(text)
    with pytest.raises(SystemExit, match=message):
        release.checked_version()


def test_a_tag_of_another_version_is_not_released(repository, monkeypatch):
    repository()
    monkeypatch.setenv("GITHUB_REF_TYPE", "tag")
    monkeypatch.setenv("GITHUB_REF_NAME", "v1.2.4")
    with pytest.raises(SystemExit, match="the tag v1.2.4 is not that of version 1.2.3"):
        release.checked_version()


def test_a_release_without_the_page_fails(repository, tmp_path_factory):
    root, source = repository(), tmp_path_factory.mktemp("source")
    with pytest.raises(SystemExit, match="the app's page is not built"):
        release.export(source)
    (root / release.PAGE).mkdir(parents=True)
    (root / release.PAGE / "index.html").touch()
    release.export(source)
    assert (source / release.PAGE / "index.html").is_file()
    assert (source / "CHANGELOG.md").is_file()
