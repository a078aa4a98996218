"""Checkpoints that are damaged, of something else, or cannot be written."""

from __future__ import annotations

import io
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy
import torch
from made_field import same
from stopped_runs import RECIPE, SMALL, count_work, interrupted

import dfd
from dfd import Field, Mesh
from dfd.runs.checkpoint import Checkpoint
from dfd.runs.fit_state import FitState
from dfd.runs.pieces import PieceFolder

pytestmark = pytest.mark.usefixtures("every_step_is_kept")


def flip(path: Path, byte: int) -> None:
    content = bytearray(path.read_bytes())
    content[byte] ^= 1
    path.write_bytes(content)


def goes_on(mesh: Mesh, encoder: Path, folder: Path, *, anew: int) -> Field:
    """What a run comes to that says `anew` times that something is begun anew."""
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        field = dfd.distill(mesh, encoder, checkpoint=folder, **SMALL)
    told = [str(warning.message) for warning in given if issubclass(warning.category, UserWarning)]
    assert len(told) == anew
    assert all("begun anew" in text and str(folder) in text for text in told)
    assert all(warning.filename == __file__ for warning in given)
    assert list(folder.parent.iterdir()) == []
    return field


@pytest.mark.parametrize("byte", [0, 32, -1])
@pytest.mark.parametrize("piece", ["tokens", "fit"])
def test_a_flipped_bit_begins_its_piece_anew(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece: str, byte: int
) -> None:
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    flip(min((tmp_path / "run").glob(f"{piece}-*")), byte)
    encoded = count_work(monkeypatch)
    assert same(goes_on(mesh, encoder, tmp_path / "run", anew=1), whole)
    assert sum(encoded) == (piece == "tokens")


def test_pieces_of_something_else_are_made_again(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    folder = PieceFolder(tmp_path / "run")
    first, second, third, fourth, fifth, _ = sorted((tmp_path / "run").glob("tokens-*"))
    first.write_bytes(first.read_bytes()[:200])
    second.write_bytes(third.read_bytes())  # whole, but another picture's
    huge = b'{"tokens":{"dtype":"F32","shape":[16000000000],"data_offsets":[0,64000000000]}}'
    folder.write(third.name, len(huge).to_bytes(8, "little") + huge)
    folder.write(fourth.name, safetensors.numpy.save({"tokens": np.full((4, 4, 16), np.nan, np.float32)}))
    fifth.write_bytes(b"")
    (tmp_path / "run" / ".fit-0.1234").write_bytes(b"half")  # what a kill amid a write leaves
    assert same(goes_on(mesh, encoder, tmp_path / "run", anew=5), whole)


def state_of(**change: Any) -> bytes:
    """A state of a fit as it is kept, with something else in it."""
    state = {"losses": torch.zeros(2), "parts": {}, "generator": torch.Generator().get_state(), **change}
    stream = io.BytesIO()
    torch.save(state, stream)
    return stream.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no state",
        state_of(),
        state_of(losses=torch.zeros(41)),
        state_of(losses=torch.zeros(())),
        state_of(parts={"network": torch.nn.Linear(2, 2).state_dict()}),
        state_of(generator=torch.zeros(3)),
    ],
)
def test_a_state_of_other_content_counts_as_none(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "run").mkdir()
    folder, network = PieceFolder(tmp_path / "run"), torch.nn.Linear(2, 3)
    folder.write("fit", content)
    with pytest.warns(UserWarning, match="fit is damaged or of something else: it is begun anew"):
        assert FitState(folder, "fit").restore({"network": network}, torch.Generator(), 40) == []


def test_a_state_that_fits_in_part_changes_nothing(tmp_path: Path) -> None:
    network, other = torch.nn.Linear(2, 2), torch.nn.Linear(2, 3)
    before = {name: value.clone() for name, value in network.state_dict().items()}
    generator = torch.Generator().manual_seed(5)
    drawn = generator.get_state()
    parts = {"one": torch.nn.Linear(2, 2).state_dict(), "two": torch.nn.Linear(2, 2).state_dict()}
    (tmp_path / "run").mkdir()
    PieceFolder(tmp_path / "run").write("fit", state_of(parts=parts))
    state = FitState(PieceFolder(tmp_path / "run"), "fit")
    with pytest.warns(UserWarning, match="fit is damaged or of something else: it is begun anew"):
        assert state.restore({"one": network, "two": other}, generator, 9) == []
    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())
    assert torch.equal(generator.get_state(), drawn)


@pytest.mark.parametrize("content", [b"\xff", b"[" * 100_000])
def test_a_damaged_recipe_begins_the_run_anew(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes
) -> None:
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    (tmp_path / "run" / "recipe.json").write_bytes(content)
    assert same(goes_on(mesh, encoder, tmp_path / "run", anew=1), whole)


@pytest.mark.parametrize("content", ['{"eggs": 3}', "[]", "beat three eggs"])
def test_somebody_elses_recipe_is_left_alone(encoder: Path, mesh: Mesh, tmp_path: Path, content: str) -> None:
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
    run = Checkpoint(tmp_path / "run", RECIPE)  # an empty folder is fine
    (tmp_path / "run" / "note.txt").write_bytes(b"dear")
    run.remove()
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["note.txt"]


def test_a_full_disk_is_one_warning(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resource = pytest.importorskip("resource")
    write, alone = PieceFolder.write, threading.Lock()

    def on_a_full_disk(self: PieceFolder, *given: Any) -> None:
        with alone:  # the limit is the whole process's
            soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
            resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
            try:
                write(self, *given)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    monkeypatch.setattr(PieceFolder, "write", on_a_full_disk)
    with pytest.warns(RuntimeWarning, match="could not be written: .*; the run goes on, but") as told:
        field = dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **SMALL)
    assert len(told) == 1
    assert same(field, whole)
    assert list(tmp_path.iterdir()) == []
