"""Test that the Python reference lists the parameters of every public function, and nothing else as a parameter."""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import dfd
from dfd.distillation.settings import DistillSettings
from dfd.editing.controls import CONTROLS
from dfd.posing.transforms import MOTIONS

sys.path.append(str(Path(__file__).resolve().parents[2] / "docs"))
with_sections = importlib.import_module("tools.docstrings").with_sections

KNOWN = {"Attributes", "Parameters", "Returns", "Raises", "Warns", "Notes"}
KEYWORDS = {*CONTROLS, *MOTIONS, *DistillSettings.model_fields}  # `**` of public functions
SELF = {"self", "cls"}


def public() -> Iterator[tuple[str, Any]]:
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


def sections(value: Any) -> dict[str, str]:
    text = with_sections(inspect.cleandoc(value.__doc__ or ""))
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def entries(text: str) -> list[str]:
    return [name for line in re.findall(r"^\S.*$", text, re.MULTILINE) for name in line.split(", ")]


@pytest.mark.parametrize("name", PUBLIC)
def test_the_reference_lists_the_parameters_of_the_signature(name: str) -> None:
    value = PUBLIC[name]
    found = sections(value)
    assert found.keys() <= KNOWN
    if "Parameters" not in found:
        return
    parameters = inspect.signature(value).parameters.values()
    own = {each.name for each in parameters if each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)}
    own -= SELF | {"merge"}
    open_ended = {each.name for each in parameters if each.kind is each.VAR_KEYWORD}
    listed = set(entries(found["Parameters"]))
    assert listed - own <= (KEYWORDS | open_ended if open_ended else set())
    assert own <= listed


@pytest.mark.parametrize("name", PUBLIC)
def test_a_short_docstring_names_every_parameter(name: str) -> None:
    value = PUBLIC[name]
    if inspect.isclass(value) or "Parameters" in sections(value) or not value.__doc__:
        return
    parameters = inspect.signature(value).parameters.values()
    names = {each.name for each in parameters if each.kind is not each.VAR_KEYWORD}
    names -= SELF | {"merge"}  # `merge` is explained at `Deformer`
    missing = {each for each in names if not re.search(rf"\b{each}\b", value.__doc__)}
    assert not missing or re.search(r"; see |as in |are those of|through ", value.__doc__), missing


def test_prose_after_parameters_becomes_notes_and_errors() -> None:
    docstring = (
        "Do it.\n\nParameters\n----------\na\n    The first.\nb, c\n    Others.\n\n    More of them.\n\n"
        "Then prose with\nwords.\n\nRaises ValueError if `a` is\nwrong. Raises OSError or TypeError as `load` does."
    )
    text = with_sections(docstring)
    assert text.startswith(
        "Do it.\n\nParameters\n----------\na\n    The first.\nb, c\n    Others.\n\n    More of them.\n\n"
    )
    assert "\n\nNotes\n-----\nThen prose with\nwords.\n\nRaises\n------\n" in text
    assert text.endswith("ValueError\n    If `a` is wrong.\nOSError or TypeError\n    As `load` does.")
