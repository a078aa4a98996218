"""Files of edits that are odd, cut short, missing or cannot be written."""

import json
import os
import re

import pytest
from sheet import full_edit, grid

from dfd.editing.edit_file import read_edit, to_document, write_edit


@pytest.fixture(scope="module")
def mesh():
    return grid(9)


@pytest.fixture
def edit(mesh):
    return full_edit(mesh)


@pytest.fixture
def document(edit, mesh):
    return to_document(edit, mesh)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no whole JSON document: Expecting value: line 1 column 1"),
        ("{}", "`format` must be"),
        ('{"version": 1, "version": 1}', "`version` is given twice"),
        ('{"version": NaN}', "numbers must be finite, got NaN"),
        ('{"version": -Infinity}', "numbers must be finite, got -Infinity"),
        ("[" * 100_000, "nested too deeply|no whole JSON document"),
    ],
)
def test_odd_files_are_refused_in_the_name_of_their_path(mesh, tmp_path, text, message):
    path = tmp_path / "odd.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_edit(path, mesh)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_file_cut_short_anywhere_is_refused(document, mesh, tmp_path):
    text = json.dumps(document)
    path = tmp_path / "cut.json"
    for length in range(0, len(text) - 1, 17):
        path.write_text(text[:length])
        with pytest.raises(ValueError, match="no whole JSON document"):
            read_edit(path, mesh)


def test_a_missing_file_and_a_folder_are_named(mesh, tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(OSError, match=f"{re.escape(str(path))}: the edit could not be read"):
            read_edit(path, mesh)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(edit, mesh, tmp_path, monkeypatch):
    path = tmp_path / "edit.json"
    path.write_text("precious")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"edit.json could not be written: No space left on device"):
        write_edit(path, edit, mesh)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]
