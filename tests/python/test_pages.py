"""Test that README and the pages of docs agree with the code. `make docs` runs the code on the pages."""

import importlib
import pkgutil
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import dfd
from dfd.cli import app as commands
from dfd.editing.controls import CONTROLS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
sys.path.append(str(DOCS))
generated = importlib.import_module("tools.generated")
PAGES = {path.relative_to(ROOT): path.read_text("utf-8") for path in (ROOT / "README.md", *sorted(DOCS.rglob("*.md")))}
TEXT = "\n".join(PAGES.values()).replace("\\\n", " ")
FENCES = "\n".join(re.findall(r"^```(?:sh|bash)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL))
CALLS = re.findall(r"(?:^    |`)dfd ([a-z]+)([^`\n]*)", TEXT, re.MULTILINE)
CALLS += re.findall(r"^dfd ([a-z]+)(.*)", FENCES, re.MULTILINE)
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Commands that `make docs` does not run: they install, build, start servers or Ray, or need data of the user, which a
# page names in capitals.
NOT_RUN = re.compile(r"pip install |make |dfd (app|batch) |export |python -m |asv |.* [A-Z]{4,}\b")
MODULES = sorted(set(re.findall(r"python -m ((?:dfd|bench)[\w.]*)", TEXT)))


@pytest.mark.parametrize("name", dfd.__all__)
def test_the_reference_has_every_public_name(name):
    assert re.search(rf":: (dfd\.)?{name}(\(.*\))?$", PAGES[Path("docs/reference/python.md")], re.MULTILINE)


def test_the_reference_calls_experimental_what_the_package_does():
    marked = "".join(re.findall(r"^__all__ \+= \[(.*)\]$", Path(dfd.__file__).read_text("utf-8"), re.MULTILINE))
    text = PAGES[Path("docs/reference/python.md")].partition("## Experimental")[2]
    assert set(re.findall(r":: (\w+)(?:\(.*\))?$", text, re.MULTILINE)) - {"dfd"} == set(re.findall(r'"(\w+)"', marked))


@pytest.mark.parametrize("control", CONTROLS)
def test_how_it_works_has_every_control(control):
    assert any(f"`{control}" in page.read_text(encoding="utf-8") for page in (DOCS / "how_it_works").glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_code_is_run_unless_it_installs_or_needs_a_server_or_data(page):
    text = PAGES[page].replace("\\\n", " ")
    lines: dict[str, list[str]] = {}
    for language, code in FENCE.findall(text):
        lines.setdefault(language, []).extend(code.splitlines())
    assert lines.keys() <= {"python", "sh", "bash", "js"}
    assert all(line.startswith("dfd ") for line in lines.get("sh", ()))  # `make docs` runs only these lines
    indented = re.findall(r"^    (.*)$", FENCE.sub("", text).partition("    @inproceedings")[0], re.MULTILINE)
    assert [line for line in [*lines.get("bash", ()), *indented] if not NOT_RUN.match(line)] == []


@pytest.mark.parametrize("page", [page for page in PAGES if "<!-- generated " in PAGES[page]], ids=str)
def test_the_tables_of_the_reference_are_those_of_the_code(page):
    stale = generated.with_tables(PAGES[page]) != PAGES[page]
    assert not stale, "run python docs/tools/generated.py, which `make docs` does, too"
    assert PAGES[page].count("<!-- generated ") == PAGES[page].count("<!-- end -->\n")


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_pages_link_to_files_that_exist(page):
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)|^:link: (\S+)$", PAGES[page], re.MULTILINE)
    for link in (a or f"{b}.md" for a, b in links):
        assert (ROOT / page.parent / link).exists(), link


@pytest.mark.parametrize("name", sorted({name for name, _ in CALLS}))
def test_every_command_has_the_options_that_the_pages_give_it(name):
    lines = [line.partition(" #")[0] for other, line in CALLS if other == name]
    own = typer.main.get_command(commands).commands[name].params
    known = {option for each in own for option in (*each.opts, *each.secondary_opts)} | {"--help"}
    assert {word for line in lines for word in re.findall(r"(?<!\S)--?[a-z][\w-]*", line)} <= known
    assert CliRunner().invoke(commands, [name, "--help"]).exit_code == 0


@pytest.mark.slow
def test_the_front_page_does_the_same_in_python_and_on_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    readme = PAGES[Path("README.md")]
    [code] = re.findall(r"^```python\n(.*?)^```$", readme, re.MULTILINE | re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})
    by_python = dfd.load("moved.glb").vertices
    Path("moved.glb").unlink()
    [command] = re.findall(r"^dfd (deform .*)$", readme, re.MULTILINE)
    result = CliRunner().invoke(commands, command.split())
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(dfd.load("moved.glb").vertices, by_python, atol=1e-5)
    assert np.abs(by_python - dfd.load("bull.glb").vertices).max() == pytest.approx(0.2, abs=1e-3)


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # other tests import them
@pytest.mark.parametrize("module", MODULES)
def test_every_module_that_the_pages_run_answers(module, monkeypatch):
    monkeypatch.setattr(sys, "argv", [module, "--help"])
    with pytest.raises(SystemExit) as left:
        sys.exit(runpy.run_module(module, run_name="__main__", alter_sys=True) and 0)
    assert not left.value.code


@pytest.mark.parametrize("target", sorted(set(re.findall(r"(?:`|^    )make ([a-z][\w-]*)", TEXT, re.MULTILINE))))
def test_every_target_that_the_pages_make_is_there(target):
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "SECURITY.md"])
def test_names_and_files_on_the_pages_for_developers_exist(page):
    text = (ROOT / page).read_text()
    for path in re.findall(r"`dfd\.([\w.]+)`", text):
        pkgutil.resolve_name(f"dfd.{path}")
    for names, file in re.findall(r"((?:`\w+`,? (?:and )?)+)in `(dfd/[\w/]+\.py)`", text):
        source = (ROOT / "python" / file).read_text()
        for name in re.findall(r"`(\w+)`", names):
            assert re.search(rf"^{name} = ", source, re.MULTILINE), name
