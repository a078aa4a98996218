"""Pose the vertices of an edit (Eq. 1 and 8). During a drag, only the handles that move are computed.

Handles of parts that lie in other parts reach their targets, too.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, Handle, box_center
from dfd.editing.weights.fill import Column, band_in, fill
from dfd.editing.weights.session_weights import SessionWeights
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY, Drag, pose
from dfd.posing.transforms import Transform

Skin = tuple[Float32, tuple[Column, ...]]  # weights (V, C), and their columns


class PosedShape:
    """Compute the posed vertices of an edit, and cache those of the latest edit.

    A `dfd.Drag` stores the displacements by all handles that do not move. It is used if an edit changes only the
    transforms of at most half of the handles. A frame only changes the weights of these handles, in their blend bands.
    """

    def __init__(self, weights: SessionWeights, skin: Skin | None = None) -> None:
        """Store the arguments. A `skin` replaces the weights of every edit."""
        self.weights, self._mesh, self._skin = weights, weights.mesh, skin
        self._edit, self._vertices = Edit(), weights.mesh.vertices
        self._drag: _MovingColumns | None = None

    def of(self, edit: Edit) -> Float64:
        """Return the posed vertices (V, 3) of `edit` in mesh units, read-only."""
        if edit is not self._edit:
            vertices = self._posed(edit)
            vertices.flags.writeable = False
            self._vertices, self._edit = vertices, edit
        return self._vertices

    def _posed(self, edit: Edit) -> Float64:
        moved = _moved(self._edit, edit)
        if moved == []:
            return self._vertices
        if moved is None or 2 * len(moved) > len(edit.handles):
            self._drag = None
            return self._vertices if _pose_key(self._edit) == _pose_key(edit) else self._whole(edit)
        if self._drag is not None and not self._drag.handles >= set(moved):
            self._drag = None
        if self._drag is None and self._skin is None:
            columns = self.weights.plan(edit)
            default = edit.default is not None and any(column.component is not None for column in columns)
            if default or any(column.crowd for column in columns) or blends_nested(edit, columns):
                return self._whole(edit)  # weights or transforms of handles at rest, or of the default, change too
        if self._drag is None:
            self._drag = _MovingColumns(self.weights, edit, moved, self._skin)
        return self._drag.pose(edit)

    def _whole(self, edit: Edit) -> Float64:
        if _pose_key(edit) == ([], None):
            return self._mesh.vertices  # nothing moves, so the weights are not needed
        bent = resting(self.weights, edit)
        if edit.default is None and not any(_moves(handle) for handle in edit.handles):
            return bent  # handles only bend and twist the parts that they hold
        weights, columns = self.weights.columns(edit) if self._skin is None else self._skin
        return pose(bent, weights, **blend_of(self._mesh, edit, weights, columns, bent))


class _MovingColumns:
    """A drag of some handles. The weights of their columns are changed in place where blend bands change."""

    def __init__(self, weights: SessionWeights, edit: Edit, moved: Sequence[int], skin: Skin | None) -> None:
        """Begin to move the handles with the indices `moved`. With a `skin`, its weights do not change."""
        values, self._all = weights.columns(edit) if skin is None else skin
        moving = [i for i, column in enumerate(self._all) if column.handle in moved]
        rest = resting(weights, edit)
        self._drag = Drag(rest, values, moving=moving, **blend_of(weights.mesh, edit, values, self._all, rest))
        rows = range(len(moving)) if edit.blending == "linear" else moving
        self._weights = [self._drag.weights[:, row] for row in rows]
        self._bands = None if skin is not None else [weights.bands(edit)[i] for i in moving]
        self._mesh, self._columns, self.handles = weights.mesh, [self._all[i] for i in moving], set(moved)

    def pose(self, edit: Edit) -> Float64:
        """Return the vertices (V, 3) of `edit`."""
        if self._bands is not None:
            for i, column in enumerate(self._columns):
                band = band_in(column, self._mesh, edit)
                if band != self._bands[i]:
                    fill(column, band, self._weights[i], band_only=True)
                    self._bands[i] = band
        turns = {} if edit.blending == "linear" else turns_of(self._mesh, edit, self._all)
        return self._drag.pose([column.matrix(edit) for column in self._columns], **turns)


def _moves(handle: Handle) -> bool:
    """Return whether a handle moves vertices beside bend and twist. A whole turn twists the band around its part."""
    return any(handle.transform.rotation) or not np.array_equal(handle.matrix, IDENTITY)


def _moved(before: Edit, after: Edit) -> list[int] | None:
    """Return the indices of the handles whose transforms differ; None if the edits differ in anything else."""
    if len(before.handles) != len(after.handles) or _without_handles(before) != _without_handles(after):
        return None
    if before.sharing != after.sharing:
        return None  # a leg or another component of a part may now follow another handle
    moved = []
    for i, (old, new) in enumerate(zip(before.handles, after.handles, strict=True)):
        if (old.place, old.controls, _bend(old)) != (new.place, new.controls, _bend(new)):
            return None
        if old.transform != new.transform:
            moved.append(i)
    return moved


def _bend(handle: Handle) -> tuple[Any, ...] | None:
    """Return a handle's bend, twist and joint, which move vertices before the blend; None if they move nothing."""
    transform = handle.transform
    return (transform.bend, transform.twist, transform.joint) if transform.bends else None


def _without_handles(edit: Edit) -> tuple[Any, ...]:
    return edit.fixed, edit.symmetry, edit.default, edit.blending, edit.preset


def _pose_key(edit: Edit) -> tuple[Any, ...]:
    """Return a cache key: everything in `edit` that changes the posed vertices.

    If displacements are added linearly, without a default transform, handles at rest move no vertex and are left out.
    """
    inert = edit.default is None and edit.rules.overlap == "add" and edit.blending == "linear"
    handles = [
        (handle.place, handle.controls, handle.transform)
        for handle in edit.handles
        if not (inert and handle.transform.rests)
    ]
    return handles, _without_handles(edit) if handles else edit.default


def resting(weights: SessionWeights, edit: Edit) -> Float64:
    """Return the resting vertices (V, 3), bent and twisted by the handles of `edit`."""
    if not any(handle.transform.bends for handle in edit.handles):
        return weights.mesh.vertices
    from dfd.editing.weights.axis_motions import bent

    return bent(weights, edit)


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
