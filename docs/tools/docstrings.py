"""Give docstrings the sections that Sphinx expects.

In the code, a paragraph after the section Parameters or Returns is prose. Sphinx would read its words as parameters, so
such paragraphs become the sections Raises and Notes before Sphinx reads them. The section Examples stays the last one.
"""

from __future__ import annotations

import re
import textwrap
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the tests use this module without Sphinx
    from sphinx.application import Sphinx

NAPOLEON = 500  # priority of the function that reads the sections; this module is called before it
RAISES = re.compile(r"(?:(?<=[.:] )|^)Raises (?=\w+Error)")
EXAMPLES = "\n\nExamples\n--------\n"
ERRORS = re.compile(r"(\w+Error(?:(?:,| or|, or) \w+Error)*),?\s*(.*)", re.DOTALL)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the function that changes docstrings."""
    app.connect("autodoc-process-docstring", _change, priority=NAPOLEON - 100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _change(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = with_sections("\n".join(lines)).splitlines()


def with_sections(docstring: str) -> str:
    """Return the docstring with its prose after sections, and its errors, in sections of their own."""
    kept: list[str] = []
    notes: list[str] = []
    errors: list[str] = []
    inside = False  # whether a section has begun
    text, heading_of_examples, examples = docstring.strip("\n").partition(EXAMPLES)
    for paragraph in re.split(r"\n\s*\n", text):
        lines = paragraph.splitlines()
        heading = len(lines) > 1 and re.fullmatch(r"-{3,}", lines[1].strip()) is not None
        prose = not heading and not any(line.startswith(" ") for line in lines)
        inside = inside or heading
        if prose and RAISES.search(" ".join(lines)):
            before, *raised = RAISES.split(" ".join(lines))
            errors += raised
            paragraph = before.strip()
        if not paragraph:
            continue
        if prose and inside:
            notes.append(paragraph)
        else:
            kept.append(paragraph)
    if notes:
        kept.append("\n\n".join(["Notes\n-----\n" + notes[0], *notes[1:]]))
    if errors:
        kept.append("Raises\n------\n" + "\n".join(map(_error, errors)))
    return "\n\n".join(kept) + heading_of_examples + examples


def _error(sentence: str) -> str:
    """Return the entry of the section Raises for a sentence such as "ValueError if the preset is unknown."."""
    found = ERRORS.match(sentence)
    assert found is not None, sentence
    text = found[2].strip()
    return f"{found[1]}\n" + textwrap.indent(text[:1].upper() + text[1:], "    ")
