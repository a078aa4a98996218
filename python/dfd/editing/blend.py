"""The arguments of `dfd.pose` for an edit. Handles of parts that lie in other parts reach their targets, too."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, box_center
from dfd.editing.weights.fill import Column
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY, pose
from dfd.posing.transforms import Transform


def blend_of(mesh: Mesh, edit: Edit, weights: Float32, columns: Sequence[Column], rest: Float64) -> dict[str, Any]:
    """Return the arguments of `pose` and `Drag` for `edit`, except the vertices `rest` (V, 3) and `weights` (V, C)."""
    found: dict[str, Any] = {
        "transforms": np.reshape([column.matrix(edit) for column in columns], (-1, 3, 4)),
        "default": None if edit.default is None else edit.default.matrix(box_center(mesh)),
        "symmetry": edit.symmetry,
        "handles": np.reshape([column.counterpart.position for column in columns], (-1, 3)),
        "overlap": edit.rules.overlap,
        "blend": edit.blending,
        **turns_of(mesh, edit, columns),
    }
    if blends_nested(edit, columns):
        nested = [number for number, column in enumerate(columns) if column.carriers]
        for number in sorted(nested, key=lambda each: columns[each].depth):
            at = columns[number].counterpart.vertex
            found["transforms"][number, :, 3] += _missing(rest[at], weights[at], number, found)
    return found


def turns_of(mesh: Mesh, edit: Edit, columns: Sequence[Column]) -> dict[str, Float64]:
    """Return the arguments `pivots` and `rotations` of `pose` for `edit`."""
    center, default = box_center(mesh), edit.default or Transform()
    turns = [column.turn(edit) for column in columns]
    turns.append((np.asarray(center if default.pivot is None else default.pivot), np.asarray(default.rotation)))
    pivots, rotations = zip(*turns, strict=True)
    return {"pivots": np.array(pivots), "rotations": np.array(rotations)}


def blends_nested(edit: Edit, columns: Sequence[Column]) -> bool:
    """Return whether dual quaternions blend a part that lies in another part."""
    return edit.blending != "linear" and any(column.carriers for column in columns)


def carried(place: Float64, row: Float32, number: int, blend: dict[str, Any]) -> Float64:
    """Return the position (3,) to which all columns except `number` move `place` (3,), whose weights are `row` (C,).

    `blend` is the result of `blend_of`.
    """
    resting = {**blend, "transforms": blend["transforms"].copy()}
    resting["transforms"][number] = IDENTITY
    if "rotations" in blend:
        resting["rotations"] = blend["rotations"].copy()
        resting["rotations"][number] = 0.0
    return _posed(place, row, resting)


def _missing(place: Float64, row: Float32, number: int, blend: dict[str, Any]) -> Float64:
    """Return the translation (3,) that is added to column `number`, so that `place` (3,) reaches its target.

    The rotations of other columns turn `place` about the pivot of this one. Translations are blended linearly.
    """
    own = blend["transforms"][number]
    target = carried(place, row, number, blend) + row[number] * (own[:, :3] @ place + own[:, 3] - place)
    reached = _posed(place, row, blend)
    return np.asarray((target - reached) / row[number]) if row[number] else np.zeros(3)


def _posed(place: Float64, row: Float32, blend: dict[str, Any]) -> Float64:
    """Return the posed position (3,) of `place` (3,), whose weights are `row` (C,)."""
    found: Float64 = pose(place[None], row[None], **blend)[0]
    return found
