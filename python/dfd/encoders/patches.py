"""Which patches of a picture show something of the shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["patch_mask"]


def patch_mask(covered: NDArray[np.bool_], side: int) -> NDArray[np.bool_]:
    """The mask (side, side) of patches that show something of the shape, or lie beside one that does.

    `covered` (R, R) tells the pixels of the shape. Tokens are read bilinearly: those one patch away count.
    """
    edges = np.arange(side + 1) * len(covered)
    begins, ends = edges[:-1] // side, -(-edges[1:] // side)  # a pixel that two patches share counts for both
    lines = np.stack([covered[begin:end].any(axis=0) for begin, end in zip(begins, ends, strict=True)])
    shown = np.stack([lines[:, begin:end].any(axis=1) for begin, end in zip(begins, ends, strict=True)], axis=1)
    framed = np.pad(shown, 1)
    wide = framed[:-2] | framed[1:-1] | framed[2:]
    return np.asarray(wide[:, :-2] | wide[:, 1:-1] | wide[:, 2:])
