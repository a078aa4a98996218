"""Test the faults of `tests.faults`: which lines change, and how."""

import ast
import builtins
from pathlib import Path
from unittest import mock

import pytest

from tests import faults

TEXT = '''"""A docstring with 0.5 in it."""
from typing import Annotated

LIMIT = 0.25  # a constant
COUNT = 3
SMALL = 1e-9


def share(values: Annotated[float, 0.5], scale=2.0) -> float:
    """Return 1.5 times a share."""
    total = 1 + values[2]
    if not values or total > 7:
        raise ValueError(f"{scale * 2.5}")
    values[0] = -scale
    values.sort(axis=1, strict=True, reverse=True)
    return total if scale else LIMIT


def __repr__(self):
    return 0.75
'''


def test_every_kind_of_fault_is_drawn_and_nothing_else_changes():
    lines = TEXT.splitlines()
    changed = set()
    for fault in faults.faults_of(Path("posing/share.py"), TEXT):
        ast.parse(fault.put_in(TEXT))
        after = fault.put_in(TEXT).splitlines()
        assert [row for row, line in enumerate(after) if line != lines[row]] == [fault.row]
        changed.add(after[fault.row].strip())
    assert changed == {
        "LIMIT = 0.5  # a constant",
        "COUNT = 6",
        "SMALL = 0.0",
        "def share(values: Annotated[float, 0.5], scale=4.0) -> float:",
        "total = 1",
        "total = values[2]",
        "total = 2 + values[2]",
        "if (total > 7):",
        "if values or total > 7:",
        "if (not values):",
        "if not values or total <= 7:",
        "if not values or total > 8:",
        "pass",
        "values[0] = scale",
        "values.sort(axis=1, strict=True, reverse=False)",
        "return total",
        "return LIMIT",
    }


def test_harmless_lines_are_left_out(monkeypatch):
    monkeypatch.setitem(faults.HARMLESS, "posing/share.py", ("COUNT =",))
    rows = {fault.row for fault in faults.faults_of(Path("posing/share.py"), TEXT)}
    assert 3 in rows
    assert 4 not in rows


def test_named_faults_and_harmless_lines_are_in_the_sources():
    names = {name.split("/")[0] for name, *_ in faults.NAMED}
    named = faults.named_faults(tuple(names))
    assert len(named) == len(faults.NAMED)
    for fault in named:
        ast.parse(fault.put_in((faults.ROOT / faults.SOURCES / fault.path).read_text()))
    for name, texts in faults.HARMLESS.items():
        source = (faults.ROOT / faults.SOURCES / name).read_text()
        with mock.patch.object(faults, "HARMLESS", {}):
            found = faults.faults_of(Path(name), source)
        lines = [source, *(fault.put_in(source).splitlines()[fault.row] for fault in found)]
        assert all(any(text in line for line in lines) for text in texts), name


def test_draws_depend_on_the_seed_alone():
    drawn = faults.drawn_faults(("posing",), 10, 1)
    assert drawn == faults.drawn_faults(("posing",), 10, 1)
    assert drawn != faults.drawn_faults(("posing",), 10, 2)
    assert {fault.package for fault in drawn} == {"posing"}


def test_a_named_fault_that_no_longer_fits_is_an_error(monkeypatch):
    monkeypatch.setattr(faults, "NAMED", [("posing/bend.py", "no such text", "")])
    with pytest.raises(ValueError, match=r"posing/bend.py: 'no such text' must occur once, but occurs 0 times"):
        faults.named_faults(("posing",))


def test_a_fault_is_given_to_the_functions_that_it_changes():
    texts = {"own.py": TEXT, "other.py": "def scaled():\n    return own.LIMIT\n"}
    rows = {line.strip(): row for row, line in enumerate(TEXT.splitlines(), 1)}
    assert faults.functions_with(texts, "own.py", rows["values[0] = -scale"]) == {"own.py:9"}
    assert faults.functions_with(texts, "own.py", rows["LIMIT = 0.25  # a constant"]) == {"own.py:9", "other.py:1"}
    assert faults.functions_with(texts, "own.py", rows["COUNT = 3"]) == set()


def test_tests_that_call_the_fault_run_first_by_what_they_found_in_a_second():
    fault = next(iter(faults.faults_of(Path("posing/share.py"), "def one():\n    return 2 < 3\n")))
    own, text = "python/dfd/posing/share.py:1", {"python/dfd/posing/share.py": "def one():\n    return 2 < 3\n"}
    called = {"slow": {own}, "quick": {own}, "finder": {own}, "other": {"python/dfd/posing/other.py:1"}}
    tests = faults.Tests(60.0, {"slow": 4.0, "quick": 1.0, "finder": 3.0, "other": 0.1}, called)
    tests.finds["finder"] = 5
    assert tests.order(fault, text) == ["finder", "quick", "slow"]


CALLING = """
@staticmethod
def outer():
    'A docstring.'
    def short(): return 1
    def inner():
        return short()
    return inner()

def other(
    value=1,
): ...

def last():
    'Nothing but a docstring.'
"""


def test_each_function_reports_its_calls(monkeypatch):
    called, names = set(), {}
    monkeypatch.setattr(builtins, faults.CALLED, called, raising=False)
    exec(faults.with_calls(CALLING, "own.py"), names)
    assert called == set()
    names["outer"]()
    names["other"]()
    assert called == {"own.py:2", "own.py:6"}
