"""The arguments of `dfd.pose` for an edit. Handles of parts that lie in other parts reach their targets, too."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, box_center
from dfd.editing.weights.fill import Column
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY, pose


def blend_of(mesh: Mesh, edit: Edit, weights: Float32, columns: Sequence[Column], rest: Float64) -> dict[str, Any]:
    """Return the arguments of `pose` and `Drag` for `edit`, except the vertices `rest` (V, 3) and `weights` (V, C)."""
    found: dict[str, Any] = {
        "transforms": np.reshape([column.matrix(edit) for column in columns], (-1, 3, 4)),
        "default": None if edit.default is None else edit.default.matrix(box_center(mesh)),
        "symmetry": edit.symmetry,
        "handles": np.reshape([column.counterpart.position for column in columns], (-1, 3)),
        "overlap": edit.rules.overlap,
        "blend": edit.blending,
    }
    if blends_nested(edit, columns):
        nested = [number for number, column in enumerate(columns) if column.carriers]
        for number in sorted(nested, key=lambda each: columns[each].depth):
            at = columns[number].counterpart.vertex
            found["transforms"][number, :, 3] += _missing(rest[at], weights[at], number, found)
    return found


def blends_nested(edit: Edit, columns: Sequence[Column]) -> bool:
    """Return whether dual quaternions blend a part that lies in another part."""
    return edit.blending != "linear" and any(column.carriers for column in columns)


def carried(place: Float64, row: Float32, number: int, blend: dict[str, Any]) -> Float64:
    """Return the position (3,) to which all columns except `number` move `place` (3,), whose weights are `row` (C,).

    `blend` is the result of `blend_of`.
    """
    transforms = blend["transforms"].copy()
    transforms[number] = IDENTITY
    return _posed(place, row, blend, transforms)


def _missing(place: Float64, row: Float32, number: int, blend: dict[str, Any]) -> Float64:
    """Return the translation (3,) that is added to column `number`, so that `place` (3,) reaches its target.

    Dual quaternions rotate the translation of one column by half of the rotation of another column. The position of
    `place` is an affine function of the translation, so four poses of this place determine it.
    """
    size = float(np.abs(blend["transforms"][number, :, 3]).max()) or 1.0
    trials = np.repeat(blend["transforms"][None], 4, axis=0)
    trials[1:, number, :, 3] += size * np.eye(3)
    start, *ends = (_posed(place, row, blend, trial) for trial in trials)
    slope = np.subtract(ends, start).T / size
    own = blend["transforms"][number]
    target = carried(place, row, number, blend) + row[number] * (own[:, :3] @ place + own[:, 3] - place)
    return np.asarray(np.linalg.lstsq(slope, target - start, rcond=1e-6)[0])


def _posed(place: Float64, row: Float32, blend: dict[str, Any], transforms: Float64) -> Float64:
    """Return the posed position (3,) of `place` (3,), whose weights are `row` (C,)."""
    found: Float64 = pose(place[None], row[None], **{**blend, "transforms": transforms})[0]
    return found
