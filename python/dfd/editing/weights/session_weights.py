"""Compute the weights of an editing session: one column for each handle, or one for each of its counterparts.

place, level ─ hold (at rest, once) ─► HeldPart ─ plan (all handles) ─► columns ─ fill (bands now) ─► weights (V, C)
"""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, Handle
from dfd.editing.weights.axis_motions import BendablePart, bendable_parts, bent
from dfd.editing.weights.counterparts import Counterpart
from dfd.editing.weights.by_features import WeightsByFeatures, Key
from dfd.editing.weights.fill import Band, band_at_rest, band_of, bands_of, fill, weights_in
from dfd.editing.weights.fixed_points import kept_by_fixed_points
from dfd.editing.weights.handle_features import HandleFeatures
from dfd.editing.weights.held_part import Component, HeldPart, hold
from dfd.editing.weights.several_handles import Column, Piece, Plan, allocated, supports
from dfd.editing.points import Place
from dfd.editing.presets import PARTLESS_REACH
from dfd.field.field import Field
from dfd.geometry.coarse import Share, nodes_of
from dfd.geometry.gaps import Gaps
from dfd.geometry.part_axis import PartAxes
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY
from dfd.posing.transforms import Transform
from dfd.segmentation.parts import Parts
from dfd.symmetry.plane import SymmetryPlane
from dfd.symmetry.search import symmetry_planes
from dfd.weights.bind import bind

TAKEN_OVER = 0.95  # a new handle takes over the motion of a component if its own has at least this IoU with it
LEAST_COUNTED = 0.35  # a counterpart counts if its largest weight is at least this fraction of the handle's largest
# `equalize` raises the weights of a counterpart if, without the factor of locality, they are at least this fraction of
# those at the handle.
LEAST_EQUALIZED = 0.1
# As a number, the reach "part" is REACH_FACTOR times the REACH_QUANTILE quantile of the feature distances between the
# handle and the vertices of the part, and at least LEAST_REACH.
LEAST_REACH, REACH_QUANTILE, REACH_FACTOR = 0.1, 0.9, 2.0
SPARE = 32  # holdings and parts of this many earlier handles are kept, for undo and for places under the pointer


class SessionWeights:
    """Compute and cache the weights of handles on one mesh, separately for each counterpart.

    `rows` returns the features of vertices and places. `parts` are the parts of the mesh. `by_features` returns the
    weights of Eq. 4 to 7, one column per handle.
    """

    def __init__(self, mesh: Mesh, field: Field, features: Any = None) -> None:
        """Store `features` (V, D), or None, as `HandleFeatures` does."""
        self.mesh, self.field = mesh, field
        self.rows = HandleFeatures(mesh, field, features)
        self.by_features = WeightsByFeatures(mesh, self.rows)
        self._axes = PartAxes(mesh)
        self._holdings: dict[Hashable, HeldPart | None] = {}  # the places used last are at the end
        self._bendable: dict[Hashable, list[BendablePart]] = {}
        self._other_parts: tuple[SymmetryPlane, Parts] | None = None
        self._plan: tuple[Hashable, Plan] | None = None
        self._filled: tuple[Plan, list[tuple[Band, ...]], Float32] | None = None

    # --- hold

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
    def gaps(self) -> Gaps:
        """Return the places where pieces of the mesh touch each other."""
        return Gaps(self.mesh)

    @cached_property
    def parts(self) -> Parts:
        """Return the parts of the mesh."""
        return Parts(self.mesh, self.rows.of_vertices, self._known_planes)

    def parts_with(self, plane: SymmetryPlane | None) -> Parts:
        """Return the parts of the mesh, which are symmetric in the planes of the shape, or in the edit's `plane`."""
        if plane is None or any(_equal(plane, known) for known in self._planes):
            return self.parts
        if self._other_parts is None or not _equal(self._other_parts[0], plane):
            self._other_parts = plane, Parts(self.mesh, self.rows.of_vertices, lambda: [plane])
        return self._other_parts[1]

    def _known_planes(self) -> list[SymmetryPlane]:
        return self._planes

    @cached_property
    def _planes(self) -> list[SymmetryPlane]:
        return symmetry_planes(self.mesh, self.field)

    def hold(
        self, place: Place, level: int = 0, plane: SymmetryPlane | None = None, *, detach: bool = False
    ) -> HeldPart | None:
        """Return the part at a place, at rest; None if there is no part, such as on a ball.

        `level` is as in `Parts.part`, and `detach` as in the function `hold`. If given, `plane` replaces the shape's
        planes of symmetry.
        """
        key = (place, level, plane, detach)
        if key in self._holdings:
            self._holdings[key] = self._holdings.pop(key)
        else:
            self._holdings[key] = self._held(place, level, plane, detach)
        return self._holdings[key]

    def _held(self, place: Place, level: int, plane: SymmetryPlane | None, detach: bool) -> HeldPart | None:
        vertex, nodes = self.rows.anchor(place), nodes_of(self.mesh)
        followed = int(nodes.follows[nodes.of_vertex[vertex]])
        if followed != nodes.of_vertex[vertex]:  # the vertex has no faces, so it follows the nearest surface
            vertex = int(nodes.members[nodes.starts[followed]])
        parts = self.parts_with(plane)
        lowest, highest = parts.levels(vertex)
        level = min(max(level, lowest), highest)
        component = parts.components(vertex, level)
        if component is None:
            return None
        region = None
        if place.region is not None:
            region = self.rows.members(place.region)
            held = nodes.of_vertex[region]
            component = component.copy()
            component[held[component[held] < 0]] = 0

        def alike() -> Float32:
            weights: Float32 = bind(self.rows.features, self.rows.points([place]))[:, 0]
            return weights

        def planes() -> Sequence[SymmetryPlane]:
            return self._planes if plane is None else [plane]

        return hold(self.mesh, component, vertex, place.position, level, alike, planes, region, detach=detach)

    def probed(self, vertex: int, level: int, affine: Float64) -> Float32 | None:
        """Return the weights (V,) of the part at a vertex that `affine` (3, 4) moves; None if there is no part.

        Counterparts are not searched, so this is fast enough to show the part under the pointer.
        """
        component = self.parts.components(vertex, level)
        if component is None:
            return None
        held = hold(self.mesh, np.minimum(component, 0), vertex, self.mesh.vertices[vertex], 0, _never, tuple)
        return _dense(held.components, self.mesh, affine)

    def reach(self, edit: Edit, handle: Handle) -> float:
        """Return the handle's `reach`. For "part", return a feature distance with a similar effect."""
        if handle.controls.reach != "part":
            return handle.controls.reach
        held = self.held(edit, handle)
        if held is None:
            return PARTLESS_REACH
        # Unit vectors have a distance d of at most 2. So with a reach of 2, all weights are 1 − d / 2.
        apart = 2.0 * (1.0 - bind(self.rows.features, self.rows.points([handle.place]), reach=2.0)[:, 0])
        within = apart[_dense(held.components, self.mesh) > 0.5]
        widest = float(np.quantile(within, REACH_QUANTILE)) if len(within) else 0.0
        return min(max(REACH_FACTOR * widest, LEAST_REACH), 2.0)

    # --- plan

    def plan(self, edit: Edit) -> Plan:
        """Return the columns of all handles. They depend on motions only by which handles move."""
        moving = self.allocating(edit)
        told = tuple((handle.place, handle.controls) for handle in edit.handles)
        key = (told, edit.fixed, edit.preset, edit.symmetry, moving)
        if self._plan is None or self._plan[0] != key:
            self._plan = key, self._planned(edit, moving)
        return self._plan[1]

    def _planned(self, edit: Edit, moving: tuple[int, ...]) -> Plan:
        columns = [
            column
            for i, handle in enumerate(edit.handles)
            for column in self._columns(edit, i, handle, split=i in moving or _is_split(handle))
        ]
        self.by_features.keep([self.key(edit, handle) for handle in edit.handles])
        for known in (self._holdings, self._bendable):
            while len(known) > max(SPARE, 2 * len(edit.handles)):
                del known[next(iter(known))]
        if not moving:
            return Plan(tuple(columns))
        nodes = nodes_of(self.mesh)
        samples, sizes = nodes.members[nodes.starts], (nodes.ends - nodes.starts).astype(np.float64)
        vertex_of = {i: self.rows.anchor(edit.handles[i].place) for i in moving}
        at_rest = self._fresh(columns, [self._resting(column) for column in columns]).T
        return allocated(columns, moving, at_rest, self.mesh.vertices, samples, sizes, vertex_of)

    def taken_over(self, edit: Edit, handle: Handle) -> Transform:
        """Return the motion that the handles of `edit` give to the component at a new handle.

        It is that of the handle that moves the same component, and none if there is no such handle, or if it bends.
        With the motion of a larger or smaller component, the shape would change at once.
        """
        moving = [i for i, each in enumerate(edit.handles) if not each.transform.rests]
        if not moving or edit.rules.overlap != "add":
            return handle.transform
        if len(moving) > 1:
            before = [column for column in self.plan(edit).columns if column.handle in moving]
        else:
            before = self._columns(edit, moving[0], edit.handles[moving[0]], split=True)
        with_new = replace(edit, handles=(*edit.handles, handle))
        columns = [self._columns(with_new, len(edit.handles), handle, split=True)[0], *before]
        nodes = nodes_of(self.mesh)
        weights = self._fresh(columns, [self._resting(column) for column in columns]).T
        held = supports(weights[:, nodes.members[nodes.starts]])
        sizes = (nodes.ends - nodes.starts).astype(np.float64)
        same = (held[1:] & held[0]) @ sizes >= TAKEN_OVER * ((held[1:] | held[0]) @ sizes)
        if not same.any():
            return handle.transform
        found = before[int(np.where(same, weights[1:, self.rows.anchor(handle.place)], -1.0).argmax())]
        source = edit.handles[found.handle]
        if source.transform.bends:
            return handle.transform
        return found.counterpart.motion(source.transform, source.place.position)

    @staticmethod
    def allocating(edit: Edit) -> tuple[int, ...]:
        """Return the indices of the moving handles, which divide components; () for fewer than two, or with "paper"."""
        moving = [i for i, handle in enumerate(edit.handles) if not handle.transform.rests]
        return tuple(moving) if len(moving) > 1 and edit.rules.overlap == "add" else ()

    def held(self, edit: Edit, handle: Handle) -> HeldPart | None:
        """Return the part that a handle holds, or whose components share its weights; None if there is no part."""
        level = handle.controls.level if handle.controls.reach == "part" else 0
        return self.hold(handle.place, level, edit.symmetry, detach=handle.controls.detach)

    def check_targets(self, edit: Edit) -> None:
        """Raise ValueError if fixed points lower the weight at a handle so much that it cannot reach its target.

        A handle that moves a part always reaches its target, unless a fixed region contains it.
        """
        if edit.fixed and edit.rules.reach_targets:
            held = [
                handle
                for handle in edit.handles
                if any(self.rows.holds(fixed.place, handle.place) for fixed in edit.fixed)
                or not self.key(edit, handle).in_part
            ]
            self.by_features.check_targets(edit, held)

    def key(self, edit: Edit, handle: Handle) -> Key:
        """Return the key of a handle's column in `by_features`."""
        in_part = handle.controls.reach == "part" and self.held(edit, handle) is not None
        return self.by_features.key(handle, edit, in_part=in_part)

    def _columns(self, edit: Edit, number: int, handle: Handle, *, split: bool) -> list[Column]:
        """Return the columns of a handle. With `split`, each counterpart has a column of its own."""
        key = self.key(edit, handle)
        weights = self.by_features.of(key)
        if key.in_part:
            return self._of_part(edit, number, handle, weights, split=split)
        assert weights is not None
        if not _needs_counterparts(handle, edit):
            return [Column(number, self._own(handle), still=_sparse(weights))]
        held = self.held(edit, handle)
        one_only = held is None or len(held.components) == 1
        shares = [None] if held is None or one_only else held.everywhere
        portions = [_portion(share, weights) for share in shares]
        on = self.counterparts(edit, handle)
        if handle.controls.follow != "none" and edit.rules.equalize:
            factors = self._equalizing(edit, handle, weights, [one for one, _ in on])
            portions = _equalized(weights, portions, factors)
        found = [(one, portion) for (one, moves), portion in zip(on, portions, strict=True) if moves]
        if split:
            shared = None if _is_split(handle) else self._own(handle)
            return [Column(number, shared or one, still=portion) for one, portion in found]
        total = np.zeros(len(weights), np.float32)
        for _, portion in found:
            total[portion.vertices] += portion.values
        return [Column(number, self._own(handle), still=_sparse(np.minimum(total, np.float32(1.0))))]

    def _of_part(
        self, edit: Edit, number: int, handle: Handle, weights: Float32 | None, *, split: bool
    ) -> list[Column]:
        """Return the columns of a handle that moves a part. `weights` (V,) are factors of the weights; None means 1."""
        held = self.held(edit, handle)
        assert held is not None
        factors = [1.0] * len(held.components)
        if weights is not None and edit.rules.equalize and handle.controls.follow != "none":
            factors = self._equalizing(edit, handle, weights, [each.counterpart for each in held.components])
        on = [moves for _, moves in self.counterparts(edit, handle)]
        pieces = self._pieces(edit, handle, held, weights, factors)
        pieces = [piece for piece, moves in zip(pieces, on, strict=True) if moves]
        if split:
            shared = None if _is_split(handle) else self._own(handle)
            return [Column(number, shared or each.component.counterpart, (each,)) for each in pieces]
        return [Column(number, self._own(handle), tuple(pieces))]

    def _pieces(
        self, edit: Edit, handle: Handle, held: HeldPart, weights: Float32 | None, factors: Sequence[float]
    ) -> list[Piece]:
        """Return the components of a part as pieces, lowered by `weights` (V,), `factors` (C,) and fixed points."""
        pieces = [_piece(one, weights, factor) for one, factor in zip(held.components, factors, strict=True)]
        if not edit.fixed or not edit.rules.reach_targets:
            return pieces
        kept = kept_by_fixed_points(self.rows, self.mesh.vertices, edit, handle, held)
        return [piece.scaled(factor) for piece, factor in zip(pieces, kept, strict=True)]

    def counterparts(self, edit: Edit, handle: Handle) -> list[tuple[Counterpart, bool]]:
        """Return the counterparts of a handle, and whether each moves with the handle. The first is the handle itself.

        Each place in `excluded_counterparts` excludes the counterpart whose component contains it, or the nearest one.
        The first counterpart always moves. The control `follow` says which others move.
        """
        held = self.held(edit, handle)
        if held is None:
            return [(self._own(handle), True)]
        follow = handle.controls.follow
        others = (one.counterpart.image is not None if follow == "mirror" else True for one in held.components[1:])
        on = [True, *(follow != "none" and moves for moves in others)]
        for place in handle.controls.excluded_counterparts:
            most = held.at(self.rows.anchor(place))
            on[most] = most == 0
        return [(each.counterpart, moves) for each, moves in zip(held.components, on, strict=True)]

    def _own(self, handle: Handle) -> Counterpart:
        """Return the handle itself as a counterpart, for a column that all counterparts of the handle share."""
        place = handle.place
        return Counterpart(self.rows.anchor(place), place.position, np.eye(3))

    def _equalizing(
        self, edit: Edit, handle: Handle, weights: Float32, counterparts: Sequence[Counterpart]
    ) -> list[float]:
        """Return factors with which similar counterparts move as much as the handle, except for locality and the mask.

        `weights` (V,) are those of the handle. The factors of locality (Eq. 7) and of the mask still lower the results.
        """
        near = self.by_features.near(edit, handle, np.array([one.vertex for one in counterparts]))
        tops = [
            float(weights[one.vertex]) / nearness if nearness > 0 else 0.0
            for one, nearness in zip(counterparts, near, strict=True)
        ]
        return [tops[0] / top if top >= LEAST_EQUALIZED * tops[0] > 0 else 1.0 for top in tops]

    def level_with_axis(self, edit: Edit, handle: Handle) -> int | None:
        """Return the level nearest to the handle's at which its part bends along an axis; None if there is none."""
        lowest, highest = self.parts_with(edit.symmetry).levels(self.rows.anchor(handle.place))
        for level in sorted(range(lowest, highest + 1), key=lambda level: abs(level - handle.controls.level)):
            other = replace(handle, controls=replace(handle.controls, level=level, reach="part"))
            parts = self.bendable_parts(replace(edit, handles=(other,), poses=()), other)
            if parts and parts[0].slender:
                return level
        return None

    # --- fill

    def columns(
        self, edit: Edit, bands: Sequence[tuple[Band, ...]] | None = None
    ) -> tuple[Float32, tuple[Column, ...]]:
        """Return the weights (V, C), read-only, one or more columns per handle, and these columns.

        `bands` are the blend bands of the columns. If it is None, the handles' transforms determine them.
        """
        plan = self.plan(edit)
        if bands is None:
            bands = self.bands(edit)
        if self._filled is None or self._filled[0] is not plan or self._filled[1] != list(bands):
            made = filled(plan, self._fresh(plan.columns, bands))
            made.flags.writeable = False
            self._filled = plan, list(bands), made
        return self._filled[2], plan.columns

    def bands(self, edit: Edit) -> list[tuple[Band, ...]]:
        """Return the blend bands of all columns of the plan of `edit`."""
        return [bands_of(column, self.mesh, edit) for column in self.plan(edit).columns]

    def _resting(self, column: Column) -> tuple[Band, ...]:
        return tuple(band_at_rest(piece.component, self.mesh.diagonal) for piece in column.pieces)

    def _fresh(self, columns: Sequence[Column], bands: Sequence[tuple[Band, ...]]) -> Float32:
        made = np.zeros((len(columns), len(self.mesh.vertices)), np.float32)
        for column, each, row in zip(columns, bands, made, strict=True):
            fill(column, each, row)
        return made.T

    def weights(self, edit: Edit) -> Float32:
        """Return the weights (V, H) of Eq. 4 to 7: each column is for a handle and all its counterparts."""
        found = np.empty((len(edit.handles), len(self.mesh.vertices)), np.float32)
        for handle, row in zip(edit.handles, found, strict=True):
            weights, held = self.by_features.of(self.key(edit, handle)), self.held(edit, handle)
            if handle.controls.reach == "part" and held is not None:
                pieces = self._pieces(edit, handle, held, weights, [1.0] * len(held.components))
                columns = [Column(0, each.component.counterpart, (each,)) for each in pieces]
                alone = Edit(handles=(handle,), default=edit.default)
                made = self._fresh(columns, [bands_of(column, self.mesh, alone) for column in columns])
                np.minimum(made.sum(axis=1), 1.0, out=row)
            else:
                row[:] = weights
        return found.T

    def following(self, edit: Edit) -> Float32:
        """Return the weights (V, H), where the column of a handle is the sum over its counterparts."""
        weights, columns = self.columns(edit)
        followed = np.zeros((len(weights), len(edit.handles)), np.float32)
        for index, column in enumerate(columns):
            followed[:, column.handle] += weights[:, index]
        return followed

    def counterpart_counts(self, edit: Edit) -> list[int]:
        """Return the number of counterparts of each handle, (H,), without those below `LEAST_COUNTED`."""
        weights, columns = self.columns(edit)
        peaks: list[list[float]] = [[] for _ in edit.handles]
        for column, peak in zip(columns, weights.max(axis=0, initial=0.0).tolist(), strict=True):
            if _is_split(edit.handles[column.handle]):
                peaks[column.handle].append(peak)
        return [max(sum(peak >= LEAST_COUNTED * max(own) for peak in own), 1) if own else 1 for own in peaks]

    # --- bend

    def bendable_parts(self, edit: Edit, handle: Handle) -> list[BendablePart]:
        """Return the connected components that follow a handle of `edit`, the component at the handle first.

        They are those at rest, so the result does not depend on how far the handle moves.
        """
        number = next(i for i, each in enumerate(edit.handles) if each.id == handle.id)
        plan = self.plan(edit)
        key = (handle.place, handle.controls, edit.fixed, edit.symmetry, edit.preset, self.allocating(edit) and plan)
        if key not in self._bendable:
            own = [column for column in plan.columns if column.handle == number]
            weights = self._fresh(own, [self._resting(column) for column in own])
            anchor = self.rows.anchor(handle.place)
            self._bendable[key] = bendable_parts(self.mesh, self._axes, anchor, weights, own, edit.symmetry)
        return self._bendable[key]

    def bent(self, edit: Edit) -> Float64:
        """Return the resting vertices (V, 3), bent and twisted by the handles of `edit`."""
        bending = {
            i: self.bendable_parts(edit, handle) for i, handle in enumerate(edit.handles) if handle.transform.bends
        }
        return bent(self.mesh, edit, bending) if bending else self.mesh.vertices


def filled(plan: Plan, weights: Float32) -> Float32:
    """Lower `weights` (V, C) in place where the sum of a crowded group exceeds 1, and return them."""
    for group, vertices in plan.crowded:
        among = np.ix_(vertices, np.array(group))
        some = weights[among]
        weights[among] = some / np.maximum(some.sum(axis=1, keepdims=True), np.float32(1.0))
    return weights


def _dense(components: Sequence[Component], mesh: Mesh, affine: Float64 = IDENTITY) -> Float32:
    """Return the weights (V,) of a part that `affine` (3, 4) moves."""
    total = np.zeros(len(mesh.vertices), np.float32)
    for each in components:
        total[each.core.vertices] += each.core.values
        total[each.vertices] += each.share * weights_in(each, band_of(each, affine, IDENTITY, mesh.diagonal))
    return total


def _never() -> Float32:
    raise AssertionError("a part with one component needs no features")


def _is_split(handle: Handle) -> bool:
    """Return whether each counterpart of a handle has its own column."""
    return handle.controls.counterparts != "shared_pivot"


def _needs_counterparts(handle: Handle, edit: Edit) -> bool:
    """Return whether the columns of a handle depend on its counterparts."""
    return _is_split(handle) or edit.rules.equalize or handle.controls.excluded_counterparts != ()


def _piece(component: Component, weights: Float32 | None, factor: float) -> Piece:
    """Return a component as a piece of a column. `weights` (V,) and `factor` multiply its weights, up to their largest.

    If `weights` is None, they are 1.
    """
    core, share = component.core, component.share
    if weights is None:
        return Piece(component, core, share)
    scaled = np.minimum(weights * np.float32(factor), weights.max(initial=0.0))
    return Piece(
        component, Share(core.vertices, core.values * scaled[core.vertices]), share * scaled[component.vertices]
    )


def _portion(share: Share | None, weights: Float32) -> Share:
    """Return the portion of a handle's `weights` (V,) that a counterpart with `share` gets."""
    if share is None:
        return _sparse(weights)
    return Share(share.vertices, weights[share.vertices] * share.values)


def _sparse(weights: Float32) -> Share:
    some = np.flatnonzero(weights)
    return Share(some, weights[some])


def _equalized(weights: Float32, portions: Sequence[Share], factors: Sequence[float]) -> list[Share]:
    """Multiply `portions` by `factors`. The sum of the results at a vertex is limited to the maximum of `weights`."""
    total = np.zeros(len(weights), np.float32)
    found = [
        Share(vertices, values * np.float32(factor))
        for (vertices, values), factor in zip(portions, factors, strict=True)
    ]
    for vertices, values in found:
        total[vertices] += values
    most = weights.max(initial=0.0)
    if (total <= most).all():
        return found
    less = np.divide(most, total, out=np.ones_like(total), where=total > most)
    return [Share(vertices, values * less[vertices]) for vertices, values in found]


def _equal(one: SymmetryPlane, other: SymmetryPlane) -> bool:
    """Return whether two planes have equal normals and offsets; their bands can differ."""
    return (one.normal, one.offset) == (other.normal, other.offset)
