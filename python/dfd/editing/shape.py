"""Pose the vertices of an edit. During a drag, only the handles that move are computed."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.blend import blend_of, blends_nested, turns_of
from dfd.editing.edit import Edit, Handle
from dfd.editing.weights.fill import Band, Column, bands_of, fill
from dfd.editing.weights.session_weights import SessionWeights
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY, Drag, pose


class PosedShape:
    """Compute the posed vertices of an edit, and cache those of the latest edit.

    A `dfd.Drag` stores the displacements by all handles that do not move. It is used if an edit changes only the
    transforms of at most half of the handles. A frame only changes the weights of these handles, in their blend bands.
    """

    def __init__(
        self, mesh: Mesh, weights: SessionWeights, columns: tuple[Float32, tuple[Column, ...]] | None = None
    ) -> None:
        """Store the arguments. `columns` are weights (V, C) and their columns for all edits, as those of a skin.

        If `columns` is None, each edit determines its own.
        """
        self._mesh = mesh
        self._weights = weights
        self._skin = columns
        self._edit = Edit()
        self._vertices = mesh.vertices
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
            plan = self._weights.plan(edit)
            default = edit.default is not None and any(column.banded for column in plan.columns)
            if plan.crowded or default or blends_nested(edit, plan.columns):
                return self._whole(edit)  # weights or transforms of handles at rest, or of the default, change too
        if self._drag is None:
            weights, columns = self._columns(edit)
            moving = [i for i, column in enumerate(columns) if column.handle in moved]
            rest = self._weights.bent(edit)
            drag = Drag(rest, weights, moving=moving, **blend_of(self._mesh, edit, weights, columns, rest))
            rows = [drag.weights[:, row] for row in (range(len(moving)) if edit.blending == "linear" else moving)]
            bands = None if self._skin is not None else [self._weights.bands(edit)[i] for i in moving]
            self._drag = _MovingColumns(self._mesh, drag, columns, moving, rows, bands)
        return self._drag.pose(edit)

    def _columns(self, edit: Edit) -> tuple[Float32, tuple[Column, ...]]:
        return self._weights.columns(edit) if self._skin is None else self._skin

    def _whole(self, edit: Edit) -> Float64:
        if _pose_key(edit) == _pose_key(Edit()):
            return self._mesh.vertices  # nothing moves, so the weights are not needed
        bent = self._weights.bent(edit)
        if edit.default is None and not any(_moves(handle) for handle in edit.handles):
            return bent  # handles only bend and twist the parts that they hold
        weights, columns = self._columns(edit)
        return pose(bent, weights, **blend_of(self._mesh, edit, weights, columns, bent))


class _MovingColumns:
    """A drag, and the columns that it moves. Their weights are changed in place where bands change."""

    def __init__(
        self,
        mesh: Mesh,
        drag: Drag,
        columns: Sequence[Column],
        moving: Sequence[int],
        weights: Sequence[Float32],
        bands: list[tuple[Band, ...]] | None,
    ) -> None:
        """Store the arguments. `moving` are the indices of the `columns` that move.

        `weights` are their columns (V,) of `drag.weights`; with `bands` None, they do not change.
        """
        self._mesh, self._drag, self._all, self._columns = mesh, drag, columns, [columns[i] for i in moving]
        self._weights, self._bands = weights, bands
        self.handles = {column.handle for column in self._columns}

    def pose(self, edit: Edit) -> Float64:
        """Return the vertices (V, 3) of `edit`."""
        if self._bands is not None:
            for i, column in enumerate(self._columns):
                bands = bands_of(column, self._mesh, edit)
                if bands != self._bands[i]:
                    fill(column, bands, self._weights[i], bands_only=True)
                    self._bands[i] = bands
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
