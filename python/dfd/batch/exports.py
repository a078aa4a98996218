"""How a deformed shape is written, by the names that `exports` takes.

The room `export` comes before this one: its writers (rigs, USD, weights) join `WRITERS`, and their names
`dfd.batch.settings.EXPORTS`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dfd.batch.settings import EXPORTS
from dfd.editing.deformer import Deformer

__all__ = ["WRITERS"]


def _plain(path: Path, deformer: Deformer) -> None:
    """The mesh with the vertices where the edit puts them."""
    deformer.mesh.save(path, deformer.vertices)


WRITERS: dict[str, Callable[[Path, Deformer], None]] = dict.fromkeys(EXPORTS, _plain)
