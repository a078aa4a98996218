"""Checkpoints that are damaged, of something else, or cannot be written."""

from __future__ import annotations

import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
from made_field import same
from stopped_runs import KEY, SMALL, count_work, interrupted

import dfd
from dfd import Field, Mesh
from dfd.distillation.checkpoint import Checkpoint, with_hash

pytestmark = pytest.mark.usefixtures("one_thread")


def flip(path: Path, byte: int) -> None:
    content = bytearray(path.read_bytes())
    content[byte] ^= 1
    path.write_bytes(content)


def goes_on(mesh: Mesh, encoder: Path, folder: Path, *, restarts: int) -> Field:
    """What a run comes to that says so many times that something is restarted."""
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        field = dfd.distill(mesh, encoder, checkpoint=folder, **SMALL)
    told = [str(warning.message) for warning in given if issubclass(warning.category, UserWarning)]
    assert len(told) == restarts
    assert all("restarted" in text and str(folder) in text for text in told)
    assert all(warning.filename == __file__ for warning in given)
    assert list(folder.parent.iterdir()) == []
    return field


@pytest.mark.parametrize("byte", [0, 32, -1])
def test_a_flipped_bit_restarts_its_picture(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, byte: int
) -> None:
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    flip(min((tmp_path / "run").glob("tokens-*")), byte)
    encoded = count_work(monkeypatch)
    assert same(goes_on(mesh, encoder, tmp_path / "run", restarts=1), whole)
    assert sum(encoded) == 1


def test_pieces_of_something_else_are_made_again(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    first, second, third, fourth, fifth, _ = sorted((tmp_path / "run").glob("tokens-*"))
    first.write_bytes(first.read_bytes()[:200])
    second.write_bytes(third.read_bytes())  # whole, but another picture's
    huge = b'{"tokens":{"dtype":"F32","shape":[16000000000],"data_offsets":[0,64000000000]}}'
    third.write_bytes(with_hash(third.name, len(huge).to_bytes(8, "little") + huge))
    unclean = safetensors.numpy.save({"tokens": np.full((4, 4, 16), np.nan, np.float32)})
    fourth.write_bytes(with_hash(fourth.name, unclean))
    fifth.write_bytes(b"")
    (tmp_path / "run" / ".tokens-0.1234").write_bytes(b"half")  # what a kill amid a write leaves
    assert same(goes_on(mesh, encoder, tmp_path / "run", restarts=5), whole)


@pytest.mark.parametrize("content", [b"\xff", b"[" * 100_000])
def test_a_damaged_key_restarts_the_run(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes
) -> None:
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    (tmp_path / "run" / "recipe.json").write_bytes(content)
    assert same(goes_on(mesh, encoder, tmp_path / "run", restarts=1), whole)


@pytest.mark.parametrize("content", ['{"eggs": 3}', "[]", "beat three eggs"])
def test_somebody_elses_file_is_left_alone(encoder: Path, mesh: Mesh, tmp_path: Path, content: str) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "recipe.json").write_text(content)
    with pytest.raises(ValueError, match="`checkpoint` must be a new folder or one of an earlier run"):
        dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **SMALL)
    assert (tmp_path / "run" / "recipe.json").read_text() == content


def test_other_folders_are_left_alone(encoder: Path, mesh: Mesh, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.png").write_bytes(b"dear")
    (tmp_path / "file").write_bytes(b"dear")
    for name, kind, message in (
        ("photos", ValueError, "`checkpoint` must be a new folder or one of an earlier run, got .*photos"),
        ("file", OSError, "`checkpoint` must be a folder, but .*file is a file"),
        ("none/run", OSError, "`checkpoint`: the folder .*none does not exist"),
    ):
        with pytest.raises(kind, match=message):
            dfd.distill(mesh, encoder, checkpoint=tmp_path / name, **SMALL)
    assert (tmp_path / "photos" / "a.png").read_bytes() == b"dear"
    (tmp_path / "run").mkdir()
    run = Checkpoint(tmp_path / "run", KEY)  # an empty folder is fine
    (tmp_path / "run" / "note.txt").write_bytes(b"dear")
    run.remove()
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["note.txt"]


def test_a_full_disk_is_one_warning(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resource = pytest.importorskip("resource")
    write, alone = Checkpoint.write_tokens, threading.Lock()

    def on_a_full_disk(self: Checkpoint, *given: Any) -> None:
        with alone:  # the limit is the whole process's
            soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
            try:
                write(self, *given)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    monkeypatch.setattr(Checkpoint, "write_tokens", on_a_full_disk)
    with pytest.warns(RuntimeWarning, match="could not be written: .*; the run continues, but") as told:
        field = dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **SMALL)
    assert len(told) == 1
    assert same(field, whole)
    assert list(tmp_path.iterdir()) == []
