"""Runs of the tiny encoder that are stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import dfd
import dfd.distillation.algorithm
from dfd import Mesh
from dfd.encoders.encode import Encoder

FEW_NODES = 1500
KEY = {"field_version": 0, "mesh": "of a test"}

SMALL: dict[str, Any] = {
    "views": 6,
    "resolution": 32,
    "steps": 40,
    "batch": 64,
    "progress": False,
    "device": "cpu",
    "cache": False,
}


def stop_at_fit(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    """Let the fit end with `error`: all pictures are encoded then."""

    def stopping(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr(dfd.distillation.algorithm, "fit", stopping)


def interrupted(mesh: Mesh, encoder: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave a run in `folder` that has all tokens."""
    with monkeypatch.context() as patch:
        stop_at_fit(patch, KeyboardInterrupt())
        with pytest.raises(KeyboardInterrupt):
            dfd.distill(mesh, encoder, checkpoint=folder, **SMALL)


def count_work(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Gets the number of pictures of every call of an encoder's network."""
    forward, done = Encoder._forward, list[int]()
    monkeypatch.setattr(
        Encoder, "_forward", lambda self, images, *rest: done.append(len(images)) or forward(self, images, *rest)
    )
    return done
