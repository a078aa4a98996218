"""The precision of an encoder: decided once per machine, by whoever is first, and known without torch."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tiny_families import Saved

from dfd.encoders import precision
from dfd.encoders.encode import load_encoder
from dfd.encoders.loading import find_identity, loaded_identity
from dfd.encoders.precision import choose_precision, saved_device, saved_precision

CPU = torch.device("cpu")

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    """The folder of notes, the test's own."""
    return tmp_path / "cache" / "precision"


def measure(monkeypatch: pytest.MonkeyPatch, *answers: bool) -> list[bool]:
    """Let the stopwatch give these answers, one after the other; what is left of them."""
    left = list(answers)
    monkeypatch.setattr(precision, "_cpu_has", lambda feature: True)
    monkeypatch.setattr(precision, "_bfloat16_pays", lambda: left.pop(0))
    return left


@pytest.mark.parametrize(
    ("has", "pays", "expected"), [(True, True, "bfloat16"), (True, False, "float32"), (False, True, "float32")]
)
def test_it_is_chosen_by_the_processor(
    dinov2: Saved, monkeypatch: pytest.MonkeyPatch, has: bool, pays: bool, expected: str
) -> None:
    monkeypatch.setattr(precision, "_cpu_has", lambda feature: has)
    monkeypatch.setattr(precision, "_bfloat16_pays", lambda: pays)
    encoder = load_encoder(dinov2.folder, device="cpu")
    assert encoder.precision == encoder.settings()["encoder_precision"] == expected


def test_the_first_decision_stands(monkeypatch: pytest.MonkeyPatch, notes: Path) -> None:
    left = measure(monkeypatch, True, False)
    assert saved_precision("cpu") is None
    assert [choose_precision(CPU) for _ in range(3)] == ["bfloat16"] * 3
    assert left == [False]
    assert saved_precision("cpu") == "bfloat16"
    assert len(list(notes.iterdir())) == 1


def test_another_machine_and_another_torch_decide_for_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    left = measure(monkeypatch, True, False)
    assert choose_precision(CPU) == "bfloat16"
    monkeypatch.setattr(precision, "_machine", lambda: "another")
    assert choose_precision(CPU) == "float32"
    assert left == []
    monkeypatch.undo()
    for change in ("metadata.version", "platform.machine"):
        with monkeypatch.context() as patch:
            here = precision._machine.__wrapped__()
            patch.setattr(f"dfd.encoders.precision.{change}", lambda *_: "0")
            assert precision._machine.__wrapped__() != here


def test_what_an_encoder_will_be_is_known_once_one_was_loaded(dinov2: Saved, monkeypatch: pytest.MonkeyPatch) -> None:
    measure(monkeypatch, True)
    assert find_identity(dinov2.folder, "cpu") is None
    encoder = load_encoder(dinov2.folder, device="cpu")
    known = find_identity(dinov2.folder, "cpu")
    assert known is not None
    assert (known["encoder_precision"], known["device"]) == ("bfloat16", "cpu")
    assert loaded_identity(dinov2.folder, "cpu", encoder) == known
    assert find_identity(encoder) == encoder.identity()
    assert find_identity(dinov2.folder) is None  # where torch computes by itself was not asked yet
    monkeypatch.setattr("dfd.encoders.encode.choose_device", lambda function, device: CPU)
    load_encoder(dinov2.folder)
    assert saved_device() == "cpu"
    assert find_identity(dinov2.folder) == known
    # An encoder with other numbers than were noted is told by itself.
    exact = load_encoder(dinov2.folder, device="cpu", precision="float32")
    assert loaded_identity(dinov2.folder, "cpu", exact) == exact.identity() != known
