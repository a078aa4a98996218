"""The posed shape of an edit. During a drag, only the handles that move are computed."""

from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.editing.edit import Edit, Handle, box_center
from dfd.editing.influence.counterparts import Column
from dfd.editing.influence.handle_weights import HandleWeights
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY, Drag, pose


class PosedShape:
    """Computes the posed vertices of an edit, and keeps those of the last one.

    While edits differ only in the transforms of a few handles, one base (`dfd.Drag`) holds the sum of all others. A
    frame then costs only what those few handles cost.
    """

    def __init__(self, mesh: Mesh, weights: HandleWeights, bands_of: Edit | None = None) -> None:
        """Pose `mesh` with `weights`; `bands_of` is as in `HandleWeights.columns`."""
        self._mesh = mesh
        self._weights = weights
        self._bands_of = bands_of
        self._edit = Edit()
        self._vertices = mesh.vertices
        self._drag: Drag | None = None
        self._moving: dict[int, list[Column]] = {}  # the columns that `_drag` can move, by handle

    def of(self, edit: Edit) -> Float64:
        """Return (V, 3) the posed vertices of `edit` in mesh units, read-only."""
        if edit is not self._edit:
            vertices = self._posed(edit)
            vertices.flags.writeable = False
            self._vertices, self._edit = vertices, edit
        return self._vertices

    def _posed(self, edit: Edit) -> Float64:
        moved = _moved(self._edit, edit)
        if moved and self._bands_of is None:
            bands = [[self._weights.grips.band(each.handles[i]) for i in moved] for each in (self._edit, edit)]
            moved = moved if bands[0] == bands[1] else None
        if moved == []:
            return self._vertices
        if moved is None or 2 * len(moved) > len(edit.handles):
            self._drag = None
            return self._vertices if _acting(self._edit) == _acting(edit) else self._whole(edit)
        if self._drag is None or not self._moving.keys() >= set(moved):
            weights, columns = self._weights.columns(edit, self._bands_of)
            moving = [i for i, column in enumerate(columns) if column.handle in moved]
            self._drag = Drag(self._weights.bent(edit), weights, moving=moving, **self._arguments(edit, columns))
            self._moving = {handle: [column for column in columns if column.handle == handle] for handle in moved}
        return self._drag.pose([column.matrix(edit) for columns in self._moving.values() for column in columns])

    def _whole(self, edit: Edit) -> Float64:
        if _acting(edit) == _acting(Edit()):
            return self._mesh.vertices  # nothing moves, whatever the weights
        bent = self._weights.bent(edit)
        if edit.default is None and all(np.array_equal(handle.matrix, IDENTITY) for handle in edit.handles):
            return bent  # only bends and twists, as in most drags of a tip
        weights, columns = self._weights.columns(edit, self._bands_of)
        return pose(bent, weights, **self._arguments(edit, columns))

    def _arguments(self, edit: Edit, columns: tuple[Column, ...]) -> dict[str, Any]:
        """Return the arguments of `pose` and `Drag` for `edit`, besides vertices and weights."""
        return {
            "transforms": np.reshape([column.matrix(edit) for column in columns], (-1, 3, 4)),
            "default": None if edit.default is None else edit.default.matrix(box_center(self._mesh)),
            "symmetry": edit.symmetry,
            "handles": np.reshape([column.counterpart.position for column in columns], (-1, 3)),
            "overlap": edit.rules.overlap,
            "blend": edit.blending,
        }


def _moved(before: Edit, after: Edit) -> list[int] | None:
    """Return the indices of handles whose transforms differ; None if the edits differ in anything else."""
    if len(before.handles) != len(after.handles) or _whole_shape(before) != _whole_shape(after):
        return None
    if HandleWeights.allocating(before) != HandleWeights.allocating(after):
        return None  # a component changed the handle that moves it
    moved = []
    for i, (old, new) in enumerate(zip(before.handles, after.handles, strict=True)):
        if (old.place, old.controls, _bend(old)) != (new.place, new.controls, _bend(new)):
            return None
        if old.transform != new.transform:
            moved.append(i)
    return moved


def _bend(handle: Handle) -> tuple[Any, ...] | None:
    """Return bend, twist and joint, which move vertices before all transforms do; None without any."""
    transform = handle.transform
    return (transform.bend, transform.twist, transform.joint) if transform.bends else None


def _whole_shape(edit: Edit) -> tuple[Any, ...]:
    return edit.fixed, edit.symmetry, edit.default, edit.blending, edit.preset


def _acting(edit: Edit) -> tuple[Any, ...]:
    """Return a cache key of everything that changes the posed vertices.

    If displacements add, handles at rest change nothing, unless they hold a place against D₀.
    """
    inert = edit.default is None and edit.rules.overlap == "add" and edit.blending == "linear"
    handles = [
        (handle.place, handle.controls, handle.transform)
        for handle in edit.handles
        if not (inert and handle.transform.rests)
    ]
    return handles, _whole_shape(edit) if handles else edit.default
