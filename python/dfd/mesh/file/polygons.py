"""Check the polygons of mesh files."""

from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.linear_algebra import Bool, Int64


def long_faces(path: Path, sizes: Int64, lines: Int64 | None = None) -> Bool:
    """Return a mask (P,) of the faces with at least three corners, and warn if other faces are left out.

    `sizes` (P,) holds the number of corners of each face, and `lines` (P,), if given, its line index in the file. The
    warning gives the line of the first face that is left out; without `lines`, it gives the index of this face.
    """
    long: Bool = sizes >= 3
    if not long.all():
        where = f"is face {long.argmin()}" if lines is None else f"in line {lines[long.argmin()] + 1}"
        check.warn(
            f"load: `path` {path} has {np.count_nonzero(~long)} faces of fewer than three corners, the first {where}; "
            "they are left out",
            UserWarning,
        )
    return long


def check_corners(corners: Int64, count: int) -> None:
    """Raise ValueError unless all corners are vertex indices from 0 to `count` − 1."""
    wrong = corners[(corners < 0) | (corners >= count)]
    if len(wrong):
        raise ValueError(f"a face names vertex {wrong[0]}, but there are {count} vertices")
