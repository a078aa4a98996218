"""How a deformed shape is written, by the names that `exports` takes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dfd.batch.settings import MOVED, RIGS, WEIGHTS
from dfd.editing.deformer import Deformer
from dfd.export.export_rig import export_rig
from dfd.export.export_weights import export_weights

__all__ = ["WRITERS"]


def _moved(path: Path, deformer: Deformer) -> None:
    """The mesh with the vertices where the edit puts them."""
    deformer.mesh.save(path, deformer.vertices)


def _rig(path: Path, deformer: Deformer) -> None:
    """The resting mesh with the handles as joints."""
    export_rig(deformer, path)


def _weights(path: Path, deformer: Deformer) -> None:
    """Arrays of what the edit holds."""
    export_weights(deformer, path)


WRITERS: dict[str, Callable[[Path, Deformer], None]] = {
    **dict.fromkeys(MOVED, _moved),
    **dict.fromkeys(RIGS, _rig),
    **dict.fromkeys(WEIGHTS, _weights),
}
