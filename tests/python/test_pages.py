"""Pages of docs that would otherwise fall behind; their code is run by `make docs`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import dfd
from dfd.editing.presets import CONTROLS, WHOLE_SHAPE

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.parametrize("name", dfd.__all__)
def test_the_reference_has_every_public_name(name: str) -> None:
    text = (DOCS / "reference" / "python.md").read_text(encoding="utf-8")
    assert re.search(rf":: (dfd\.)?{name}$", text, re.MULTILINE)


@pytest.mark.parametrize("control", [*CONTROLS, *WHOLE_SHAPE])
def test_how_it_works_has_every_control(control: str) -> None:
    assert any(f"`{control}" in page.read_text(encoding="utf-8") for page in (DOCS / "how_it_works").glob("*.md"))
