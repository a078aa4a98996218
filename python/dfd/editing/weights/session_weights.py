"""Compute the weights of an editing session: one column for each handle, or one for each of its counterparts.

place, level ─ part (segmentation) ─ held part ─ share (several handles) ─ columns ─ fill (motion) ─ weights (V, C)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from dfd.common.linear_algebra import Float32
from dfd.editing.edit import Edit, Handle
from dfd.editing.points import Place
from dfd.editing.weights.fill import Band, Column, Counterpart, band_in, filled, whole
from dfd.editing.weights.handle_features import MOST, SPARE, HandleFeatures
from dfd.editing.weights.held_part import HeldPart, hold
from dfd.field.field import Field
from dfd.geometry.coarse import nodes_of
from dfd.geometry.part_axis import PartAxes
from dfd.mesh.mesh import Mesh
from dfd.segmentation.parts import Parts
from dfd.symmetry.plane import SymmetryPlane
from dfd.symmetry.search import symmetry_planes
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.editing.weights.by_features import WeightsByFeatures


class SessionWeights:
    """Compute the weights of handles on one mesh, separately for each counterpart.

    `rows` returns the features of vertices and places, and has the cache of all steps. `parts` are the parts of the
    mesh.
    """

    def __init__(self, mesh: Mesh, field: Field, features: Any = None, *, full: bool = False) -> None:
        """Store `features` (V, D), or None, as `HandleFeatures` does, and use them in full if wanted."""
        self.mesh, self.field = mesh, field
        self.rows = HandleFeatures(mesh, field, features, full=full)
        self.axes, self._kept = PartAxes(mesh), self.rows.kept

    # --- once per mesh

    def prepare(self, planes: Sequence[SymmetryPlane], parts: Parts | None = None) -> Parts:
        """Compute all data that does not depend on a place, and return the parts of the mesh.

        A call takes seconds for a million faces, and may run on another thread. `planes` are the result of
        `symmetry_planes`. If this method ran in another session with this mesh and field, `parts` may be that result.
        """
        self._planes = list(planes)
        if parts is None:
            parts = self.parts
            parts.prepare()
            _ = nodes_of(self.mesh).tree
        self.parts = parts
        return parts

    @cached_property
    def _planes(self) -> list[SymmetryPlane]:
        return symmetry_planes(self.mesh, self.field)

    def _known_planes(self) -> list[SymmetryPlane]:
        return self._planes

    @cached_property
    def parts(self) -> Parts:
        """Return the parts of the mesh."""
        return Parts(self.mesh, self.rows.of_vertices, self._known_planes)

    def parts_with(self, plane: SymmetryPlane | None) -> Parts:
        """Return the parts of the mesh, which are symmetric in the planes of the shape, or in the edit's `plane`.

        The bands of planes do not matter.
        """
        if plane is None or any((plane.normal, plane.offset) == (each.normal, each.offset) for each in self._planes):
            return self.parts
        key = plane.normal, plane.offset
        return self._kept.get("parts", key, lambda: Parts(self.mesh, self.rows.of_vertices, lambda: [plane]))

    @cached_property
    def by_features(self) -> WeightsByFeatures:
        """Return the weights by features, which only some controls need."""
        from dfd.editing.weights.by_features import WeightsByFeatures

        return WeightsByFeatures(self.mesh, self.rows)

    def make_room(self, handles: int) -> None:
        """Let the cache keep what `handles` handles need, and not much more."""
        self._kept.most = max(SPARE, 2 * handles)
        large = max(handles, 1)
        self._kept.of_step = {**MOST, **dict.fromkeys(("column", "distances", "shares"), large)}

    # --- for one handle: place, level → part → held part → its columns

    def held(self, edit: Edit, handle: Handle) -> HeldPart | None:
        """Return the part that a handle holds at rest, or whose components share its weights; None if there is none.

        On a ball, for example, there is no part. The plane of symmetry of `edit` replaces the planes of the shape.
        """
        controls = handle.controls
        level = controls.level if controls.reach == "part" else 0
        key = handle.place, level, edit.symmetry, controls.detach
        return self._kept.get("part", key, lambda: self._hold(*key))

    def _hold(self, place: Place, level: int, plane: SymmetryPlane | None, detach: bool) -> HeldPart | None:
        vertex, nodes = self.rows.anchor(place), nodes_of(self.mesh)
        followed = int(nodes.follows[nodes.of_vertex[vertex]])
        if followed != nodes.of_vertex[vertex]:  # the vertex has no faces, so it follows the nearest surface
            vertex = int(nodes.members[nodes.starts[followed]])
        parts = self.parts_with(plane)
        lowest, highest = parts.levels(vertex)
        component = parts.components(vertex, min(max(level, lowest), highest))
        if component is None:
            return None
        region = None
        if place.region is not None:
            region = self.rows.members(place.region)
            inside = nodes.of_vertex[region]
            component = component.copy()
            component[inside[component[inside] < 0]] = 0
        similar, planes = None, [plane] if plane is not None else []
        if component.max() > 0:
            similar = bind(self.rows.features, self.rows.points([place]))[:, 0]
            planes = planes or self._planes
        return hold(self.mesh, component, vertex, place.position, similar, planes, region, detach=detach)

    def all_columns(self, edit: Edit, handle: Handle, held: HeldPart | None, *, equalize: bool) -> list[Column]:
        """Return a column for each component of `held`; without a part, one column with weights by features."""
        number, in_part = edit.number(handle), held is not None and handle.controls.reach == "part"
        if held is None or not in_part or _lowers(handle, edit):
            columns = self.by_features.columns(edit, number, held, self.own(handle), equalize=equalize)
        else:
            columns = [whole(number, each) for each in held.components]
        if held is None or not in_part or not edit.fixed or not edit.rules.reach_targets:
            return columns
        from dfd.editing.weights.fixed_points import kept_by_fixed_points

        kept = kept_by_fixed_points(self.rows, self.mesh.vertices, edit, handle, held)
        return [column.scaled(factor) for column, factor in zip(columns, kept, strict=True)]

    def counterparts(self, handle: Handle, held: HeldPart | None) -> list[tuple[Counterpart, bool]]:
        """Return the counterparts of a handle, which holds `held`, and whether each moves. The first is the handle.

        Each place in `excluded_counterparts` excludes the counterpart whose component contains it, or the nearest one.
        The first counterpart always moves. The control `follow` says which others move.
        """
        if held is None:
            return [(self.own(handle), True)]
        follow = handle.controls.follow
        others = (one.counterpart.image is not None if follow == "mirror" else True for one in held.components[1:])
        moving = [True, *(follow != "none" and moves for moves in others)]
        for place in handle.controls.excluded_counterparts:
            most = held.at(self.rows.anchor(place))
            moving[most] = most == 0
        return [(each.counterpart, moves) for each, moves in zip(held.components, moving, strict=True)]

    def own(self, handle: Handle) -> Counterpart:
        """Return the handle itself as a counterpart."""
        return Counterpart(self.rows.anchor(handle.place), handle.place.position, np.eye(3))

    def columns_of(self, edit: Edit, handle: Handle) -> list[Column]:
        """Return the columns of a handle: one for each counterpart that moves."""
        # place, level → part → held part: depths d, shares s and distances a of Eq. 9, and the limits of Eq. 10 to 12
        held = self.held(edit, handle) if _needs_counterparts(handle, edit) else None
        # what controls and fixed points leave of each component, and which components move
        columns = self.all_columns(edit, handle, held, equalize=edit.rules.equalize)
        moving = [moves for _, moves in self.counterparts(handle, held)]
        found = [column for column, moves in zip(columns, moving, strict=True) if moves]
        return found if is_split(handle) else [replace(column, counterpart=found[0].counterpart) for column in found]

    # --- for all handles: columns → bands for the motions → weights

    def plan(self, edit: Edit) -> tuple[Column, ...]:
        """Return the columns of all handles. They depend on motions only by which handles move.

        If several handles move, `several_handles` decides which of them moves which component.
        """
        told = tuple((handle.place, handle.controls) for handle in edit.handles)
        key = (told, edit.fixed, edit.preset, edit.symmetry, edit.sharing)
        return self._kept.get("plan", key, lambda: self._planned(edit))

    def _planned(self, edit: Edit) -> tuple[Column, ...]:
        self.make_room(len(edit.handles))
        columns = [column for handle in edit.handles for column in self.columns_of(edit, handle)]
        if not edit.sharing:
            return tuple(columns)
        from dfd.editing.weights.several_handles import shared

        vertex_of = {number: self.rows.anchor(edit.handles[number].place) for number in edit.sharing}
        return shared(columns, vertex_of, self.mesh)

    def bands(self, edit: Edit, moved: Edit | None = None) -> list[Band]:
        """Return the blend bands of all columns of the plan of `edit` (Eq. 10 to 12), for the motions of `moved`.

        If `moved` is None, the motions are those of `edit`.
        """
        return [band_in(column, self.mesh, moved or edit) for column in self.plan(edit)]

    def columns(self, edit: Edit, bands: Sequence[Band] | None = None) -> tuple[Float32, tuple[Column, ...]]:
        """Return the weights (V, C), read-only, one or more columns per handle, and these columns (Eq. 9).

        `bands` are the blend bands of the columns. If it is None, the handles' transforms determine them.
        """
        columns = self.plan(edit)
        chosen = tuple(self.bands(edit) if bands is None else bands)

        def find() -> Float32:
            weights = filled(columns, chosen, self.mesh)
            if edit.sharing:
                from dfd.editing.weights.several_handles import limited

                weights = limited(columns, weights)
            weights.flags.writeable = False
            return weights

        return self._kept.get("weights", (columns, chosen), find), columns


def is_split(handle: Handle) -> bool:
    """Return whether each counterpart of a handle has its own pivot."""
    return handle.controls.counterparts != "shared_pivot"


def _needs_counterparts(handle: Handle, edit: Edit) -> bool:
    """Return whether the columns of a handle depend on its counterparts."""
    controls, equalize = handle.controls, edit.rules.equalize
    return controls.reach == "part" or is_split(handle) or equalize or controls.excluded_counterparts != ()


def _lowers(handle: Handle, edit: Edit) -> bool:
    """Return whether a control, or Eq. 6 of fixed points, lowers the weights of the part that a handle holds."""
    controls, by_equation = handle.controls, bool(edit.fixed) and not edit.rules.reach_targets
    near = controls.locality > 0 or controls.radius is not None
    return near or controls.strength != 1 or controls.mask is not None or by_equation
