"""Smooth features lie in few directions: there they are spread and fitted, and the field's last layer turns them back.

Of the targets' squared length, 64 of a DINOv2-small's 384 directions leave out less than one part in ten thousand. The
weights are no different, and the work of the last layer and of everything after it is a third.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from dfd.field.field import Field

__all__ = ["MOST", "main_directions", "turned"]

MOST = 128  # directions that are kept; as many as there are, where a feature is no wider


def main_directions(rows: NDArray[np.float32], weight: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the directions, orthonormal rows (d, D), of the largest moments of `rows` (N, D), the largest first.

    `weight` (N,) tells how much each row counts.
    """
    weighted = rows * np.sqrt(weight / weight.max()).astype(np.float32)[:, None]
    return np.ascontiguousarray(np.linalg.eigh(weighted.T @ weighted)[1].T[: -MOST - 1 : -1])


def turned(field: Field, directions: NDArray[np.float32]) -> Field:
    """Return the field whose features are those of `field` (width d) times `directions` (d, D): of width D.

    The directions are orthonormal, so that lengths stay as they are, and the last layer can do it.
    """
    how = {name: getattr(field, name) for name in ("width", "layers", "octaves", "settings")}
    wide = Field.seeded(0, directions.shape[1], center=field.center.cpu(), scale=float(field.scale), **how)
    state = field.cpu().state_dict()
    last = f"network.{len(field.network) - 1}"
    basis = torch.from_numpy(directions).T
    state |= {f"{last}.{name}": basis @ state[f"{last}.{name}"] for name in ("weight", "bias")}
    wide.load_state_dict(state)
    return wide.eval().requires_grad_(False)
