"""Runs of the tiny encoder that are stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import dfd
from dfd import Mesh
from dfd.encoders.encode import Encoder
from dfd.runs.fit_state import FitState

FEW_NODES = 1500
RECIPE = {"format": 0, "code": "of a test"}

SMALL: dict[str, Any] = {
    "views": 6,
    "resolution": 32,
    "steps": 40,
    "batch": 64,
    "progress": False,
    "device": "cpu",
    "cache": False,
}


def stop_at(monkeypatch: pytest.MonkeyPatch, step: int, error: BaseException) -> None:
    """Let the fit end with `error` after a step; by kernels it is kept after every tenth."""
    for name in ("keep", "keep_arrays"):
        keep = getattr(FitState, name)

        def stopping(self: FitState, losses: list[Any], *rest: Any, keep: Any = keep) -> None:
            keep(self, losses, *rest)
            if len(losses) == step:
                raise error

        monkeypatch.setattr(FitState, name, stopping)


def interrupted(mesh: Mesh, encoder: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave a run in `folder` that has all tokens and ten steps of its fit."""
    with monkeypatch.context() as patch:
        stop_at(patch, 10, KeyboardInterrupt())
        with pytest.raises(KeyboardInterrupt):
            dfd.distill(mesh, encoder, checkpoint=folder, **SMALL)


def count_work(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Gets the number of pictures of every call of an encoder's network."""
    forward, done = Encoder._forward, list[int]()
    monkeypatch.setattr(
        Encoder, "_forward", lambda self, images, *rest: done.append(len(images)) or forward(self, images, *rest)
    )
    return done
