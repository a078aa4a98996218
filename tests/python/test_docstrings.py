"""Test the docstrings: the reference lists the parameters of public functions and nothing else, and all code runs."""

import ast
import doctest
import inspect
import re
from pathlib import Path

import pytest

import dfd
from dfd.distillation.settings import DistillSettings
from dfd.editing.controls import CONTROLS
from dfd.posing.transforms import MOTIONS

ROOT = Path(__file__).resolve().parents[2]
KNOWN = {"Attributes", "Parameters", "Returns", "Raises", "Warns", "Examples"}
KEYWORDS = {"matrix", *CONTROLS, *MOTIONS, *DistillSettings.model_fields}  # `**` of public functions
SELF = {"self", "cls"}


def public():
    """Return every public function and class with its name, and the public methods of the classes."""
    samples = {f"samples.{name}": getattr(dfd.samples, name) for name in ("Sample", "chair", "quadruped", "robot")}
    named = {name: getattr(dfd, name) for name in dfd.__all__ if name != "samples"} | samples
    for name, value in named.items():
        yield name, value
        if inspect.isclass(value):
            for inner, method in inspect.getmembers(value, callable):
                if not inner.startswith("_") and (method.__module__ or "").startswith("dfd."):
                    yield f"{name}.{inner}", method


PUBLIC = dict(public())


def sections(value):
    text = inspect.cleandoc(value.__doc__ or "")
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def entries(text):
    return [name for line in re.findall(r"^\S.*$", text, re.MULTILINE) for name in line.split(", ")]


@pytest.mark.parametrize("name", PUBLIC)
def test_the_reference_lists_the_parameters_of_the_signature(name):
    value = PUBLIC[name]
    found = sections(value)
    assert found.keys() <= KNOWN
    # Prose stands before the sections: Sphinx reads each line in them that is not indented as a name.
    for section, text in found.items():
        assert section == "Examples" or "Raises " not in " ".join(entries(text))
    if "Parameters" not in found:
        return
    parameters = inspect.signature(value).parameters.values()
    own = {each.name for each in parameters if each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)}
    own -= SELF | {"merge"}
    open_ended = {each.name for each in parameters if each.kind is each.VAR_KEYWORD}
    listed = set(entries(found["Parameters"]))
    assert listed - own <= (KEYWORDS | open_ended if open_ended else set())
    assert own <= listed


def test_the_reference_lists_all_motions_and_controls_of_a_handle():
    assert {*CONTROLS, *MOTIONS} <= set(entries(sections(PUBLIC["Deformer.add"])["Parameters"]))


def docstrings():
    """Yield the docstrings of all modules, classes and functions of the package, with their names."""
    for path in sorted((ROOT / "python" / "dfd").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
                yield f"{path.stem}.{getattr(node, 'name', '')}", text


DOCSTRINGS = list(docstrings())
EXAMPLES = {name: text for name, text in DOCSTRINGS if ">>> " in text}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_in_docstrings_run_in_an_empty_folder(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example = doctest.DocTestParser().get_doctest(EXAMPLES[name], {}, name, None, None)
    assert example.examples
    said: list[str] = []
    assert doctest.DocTestRunner().run(example, out=said.append).failed == 0, "".join(said)
