"""Test the keywords of `Deformer.add`, `move` and `change`: their names, and that mypy finds a misspelled one."""

import subprocess
import sys

import pytest

from dfd.editing.controls import CONTROLS
from dfd.editing.verbs import ControlOptions, HandleOptions, MotionOptions
from dfd.posing.transforms import MOTIONS


def test_the_keywords_are_those_of_the_tables():
    assert set(MotionOptions.__annotations__) == {*MOTIONS, "matrix"}
    assert set(ControlOptions.__annotations__) == set(CONTROLS)
    assert HandleOptions.__optional_keys__ == {*MOTIONS, "matrix", *CONTROLS}


@pytest.mark.slow
def test_mypy_finds_a_misspelled_keyword(tmp_path):
    text = """
import dfd

def edit(session: dfd.Deformer) -> None:
    handle = session.add(5, reach=2.0, rotation=(0, 30, 0))
    session.move(handle, matrix=[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])
    session.change(handle, falloff="smooth")
    session.change(handle, raech=2.0)
"""
    (tmp_path / "code.py").write_text(text)
    command = [sys.executable, "-m", "mypy", "--no-incremental", "--follow-imports=silent", str(tmp_path / "code.py")]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    errors = [line for line in found.stdout.splitlines() if "error" in line and "code.py:" in line]
    assert len(errors) == 1, found.stdout
    assert "raech" in errors[0]
