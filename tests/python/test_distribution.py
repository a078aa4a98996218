"""Test the metadata and the files of the distributions, and that files of the project agree on them."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

from dfd.common.distribution import DISTRIBUTION

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
sys.path.append(str(ROOT / "tests" / "wheel"))
with_address = importlib.import_module("release").with_address


def test_the_distribution_has_one_name():
    assert PROJECT["project"]["name"] == DISTRIBUTION
    extras = str(PROJECT["project"]["optional-dependencies"])
    assert set(re.findall(r"'([^'>]+)\[app", extras)) == {DISTRIBUTION}


def test_no_page_promises_a_release_that_does_not_exist():
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        assert not re.search(rf'pip install "?{DISTRIBUTION}\b', page.read_text("utf-8")), page


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
    text = with_address((ROOT / "README.md").read_text("utf-8"), "https://example.org/dfd", "1.2")
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
