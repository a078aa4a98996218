"""Compute the weights of an editing session: one column for each handle, or one for each of its counterparts."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, Handle
from dfd.editing.influence.allocation import divided, kept_columns, same_and_nested
from dfd.editing.influence.counterparts import Column, Counterpart
from dfd.editing.influence.feature_weights import FeatureWeights
from dfd.editing.influence.grips import Grips
from dfd.editing.influence.handle_features import HandleFeatures
from dfd.editing.influence.held_parts import HeldPart, bent, held_parts
from dfd.editing.influence.recent import Recent
from dfd.field.field import Field
from dfd.geometry.coarse import Share, nodes_of
from dfd.geometry.part_axis import PartAxes
from dfd.mesh.mesh import Mesh
from dfd.segmentation.parts import AT_REST, Band

COMPONENT_THRESHOLD = 0.5  # a column's component: the vertices with at least this fraction of its largest weight
LEAST_COUNTED = 0.35  # a counterpart counts if its largest weight is at least this fraction of the handle's largest
# `equalize` raises the weights of a counterpart only if its weight by features alone is at least LEAST_ALIKE. Its final
# weight, without the factor of locality, must also be at least LEAST_EQUALIZED times that at the handle.
LEAST_ALIKE, LEAST_EQUALIZED = 0.15, 0.1


class HandleWeights:
    """Compute and cache the weights of handles on one mesh, separately for each counterpart.

    `rows` returns the features of vertices and places. `grips` returns the parts and counterparts at places.
    `by_features` returns the weights of Eq. 4 to 7, one column per handle.
    """

    def __init__(self, mesh: Mesh, field: Field, features: Any = None) -> None:
        """Store `features` (V, D), or None, as `HandleFeatures` does."""
        self.mesh, self.field = mesh, field
        self.rows = HandleFeatures(mesh, field, features)
        self.grips = Grips(mesh, field, self.rows)
        self.by_features = FeatureWeights(mesh, self.rows, self.grips)
        self._axes = PartAxes(mesh)
        self._owned: Recent[Counterpart] = Recent(64)  # finding the vertex nearest to a point is slow
        self._held_parts: Recent[list[HeldPart]] = Recent(64)
        self._made: Recent[tuple[Float32, tuple[Column, ...]]] = Recent(1)

    def columns(self, edit: Edit, bands: Sequence[Band] | None = None) -> tuple[Float32, tuple[Column, ...]]:
        """Return the weights (V, C), one or more columns per handle, and the handle and counterpart of each column.

        `bands` is as in `FeatureWeights.of`.
        """
        weights, keys = self.by_features.of(edit, bands)
        if not any(_needs_counterparts(handle, edit) for handle in edit.handles):
            return weights, tuple(Column(i, self._own(handle)) for i, handle in enumerate(edit.handles))
        controls = tuple(handle.controls for handle in edit.handles)
        key = (keys, controls, edit.preset, edit.symmetry, self.allocating(edit))
        return self._made.get(key, lambda: self._columns(edit, weights, [each.band for each in keys]))

    def _columns(self, edit: Edit, weights: Float32, bands: Sequence[Band]) -> tuple[Float32, tuple[Column, ...]]:
        # With weights at rest, the decisions about columns do not depend on how far the handles move.
        at_rest = weights if set(bands) == {AT_REST} else self.by_features.of(edit, [AT_REST] * len(bands))[0]
        portions, columns = self._split(edit, weights, at_rest, bands)
        if self.allocating(edit):
            resting = portions if at_rest is weights else self._split(edit, at_rest, at_rest, [AT_REST] * len(bands))[0]
            portions, columns = self._allocated(edit, portions, columns, resting)
        made = np.zeros((len(columns), len(weights)), np.float32)
        for column, (vertices, values) in zip(made, portions, strict=True):
            column[vertices] = values
        return made.T, tuple(columns)

    def _split(
        self, edit: Edit, weights: Float32, at_rest: Float32, bands: Sequence[Band]
    ) -> tuple[list[Share], list[Column]]:
        """Return the columns of all handles, and their portions of `weights` (V, H)."""
        portions: list[Share] = []
        columns: list[Column] = []
        for i, handle in enumerate(edit.handles):
            found = self._portions(edit, handle, weights[:, i], at_rest[:, i], bands[i])
            if _is_split(handle):
                columns += [Column(i, one) for one, _ in found]
                portions += [portion for _, portion in found]
            else:
                columns.append(Column(i, self._own(handle)))
                portions.append(_sum([portion for _, portion in found], len(weights)))
        return portions, columns

    def following(self, edit: Edit) -> Float32:
        """Return the weights (V, H), where the column of a handle is the sum over its counterparts."""
        weights, columns = self.columns(edit)
        followed = np.zeros((len(weights), len(edit.handles)), np.float32)
        for index, column in enumerate(columns):
            followed[:, column.handle] += weights[:, index]
        return followed

    def held_parts(self, edit: Edit, handle: Handle) -> list[HeldPart]:
        """Return the connected components that follow a handle of `edit`, the component at the handle first.

        The blend bands are those at rest, so the result does not depend on how far the handle moves.
        """
        number = next(i for i, each in enumerate(edit.handles) if each.id == handle.id)
        moving = self.allocating(edit)
        others = tuple((each.place, each.controls) for each in edit.handles) if moving else ()
        key = (self.by_features.key(handle, edit, AT_REST), handle.controls, edit.preset, edit.symmetry, others, moving)

        def find() -> list[HeldPart]:
            weights, columns = self.columns(edit, [AT_REST] * len(edit.handles))
            own = [(weights[:, i], column) for i, column in enumerate(columns) if column.handle == number]
            return held_parts(self.mesh, self._axes, self.rows.anchor(handle.place), own, edit.symmetry)

        return self._held_parts.get(key, find)

    def bent(self, edit: Edit) -> Float64:
        """Return the resting vertices (V, 3), bent and twisted by the handles of `edit`."""
        bending = {i: self.held_parts(edit, handle) for i, handle in enumerate(edit.handles) if handle.transform.bends}
        return bent(self.mesh, edit, bending) if bending else self.mesh.vertices

    def counterparts(self, edit: Edit, handle: Handle, band: Band | None = None) -> list[tuple[Counterpart, bool]]:
        """Return the counterparts of a handle, and whether each moves with the handle. The first is the handle itself.

        Each place in `excluded_counterparts` excludes one counterpart: the one with the largest `Counterpart.share` at
        this place, if the handle is at rest. If all shares there are 0, the nearest one is excluded. The first
        counterpart always moves. If the control `counterparts` is "only", no other moves. If `band` is None, the
        handle's transform determines it.
        """
        everywhere = handle.controls.reach != "part"
        level = 0 if everywhere else handle.controls.level
        band = self.grips.band(handle) if band is None else band
        found, resting = (
            self.grips.held(handle.place, level, each, everywhere=everywhere, plane=edit.symmetry).counterparts
            for each in (band, AT_REST)
        )
        on = [True] + [handle.controls.counterparts != "only"] * (len(found) - 1)
        for place in handle.controls.excluded_counterparts:
            here = self.rows.anchor(place)
            shares = [1.0 if one.share is None else one.share.at(here) for one in resting]
            if not any(shares):
                shares = [-math.dist(one.position, self.mesh.vertices[here]) for one in found]
            most = int(np.argmax(shares))
            on[most] = most == 0
        return list(zip(found, on, strict=True))

    def counterpart_counts(self, edit: Edit) -> list[int]:
        """Return the number of counterparts of each handle, (H,), without those below `LEAST_COUNTED`."""
        weights, columns = self.columns(edit)
        peaks: list[list[float]] = [[] for _ in edit.handles]
        for column, peak in zip(columns, weights.max(axis=0, initial=0.0).tolist(), strict=True):
            peaks[column.handle].append(peak)
        return [max(sum(peak >= LEAST_COUNTED * max(own) for peak in own), 1) if own else 1 for own in peaks]

    @staticmethod
    def allocating(edit: Edit) -> tuple[int, ...]:
        """Return the indices of the moving handles, for `_allocated`; () for fewer than two, or with "paper"."""
        moving = [i for i, handle in enumerate(edit.handles) if not handle.transform.rests and _is_split(handle)]
        return tuple(moving) if len(moving) > 1 and edit.rules.overlap == "add" else ()

    def _allocated(
        self, edit: Edit, portions: list[Share], columns: list[Column], resting: list[Share]
    ) -> tuple[list[Share], list[Column]]:
        """Assign the components of parts to the moving handles. Return the remaining `portions` and `columns`.

        `resting` are the portions if all handles are at rest.
        """
        moving = self.allocating(edit)
        among = [i for i, column in enumerate(columns) if column.handle in moving]
        nodes = nodes_of(self.mesh)
        samples, sizes = nodes.members[nodes.starts], (nodes.ends - nodes.starts).astype(np.float64)
        on_samples = np.stack([resting[i].dense(len(self.mesh.vertices))[samples] for i in among])
        held = (on_samples >= COMPONENT_THRESHOLD * on_samples.max(axis=1, keepdims=True)) & (on_samples > 0)
        same, nested = same_and_nested(held, sizes)
        kept = kept_columns([columns[i].handle for i in among], same)
        same, nested = same[np.ix_(kept, kept)], nested[np.ix_(kept, kept)]
        kept = [among[k] for k in kept]
        handle_of = [columns[i].handle for i in kept]
        nested &= np.not_equal.outer(handle_of, handle_of)
        vertex_of = {handle_of.index(i): self.rows.anchor(edit.handles[i].place) for i in dict.fromkeys(handle_of)}
        result = divided([portions[i] for i in kept], self.mesh.vertices, vertex_of, same, nested)
        order = [i for i, column in enumerate(columns) if i in kept or column.handle not in moving]
        portions, columns = list(portions), list(columns)
        for k, i in enumerate(kept):
            carriers = tuple(order.index(kept[j]) for j in np.flatnonzero(nested[k]))
            columns[i], portions[i] = columns[i]._replace(carriers=carriers), result[k]
        return [portions[i] for i in order], [columns[i] for i in order]

    def _own(self, handle: Handle) -> Counterpart:
        """Return the handle itself as a counterpart, for a column that all counterparts of the handle share."""
        place = handle.place
        return self._owned.get(place, lambda: Counterpart(self.rows.anchor(place), place.position, np.eye(3)))

    def _portions(
        self, edit: Edit, handle: Handle, weights: Float32, at_rest: Float32, band: Band
    ) -> list[tuple[Counterpart, Share]]:
        """Return the moving counterparts of a handle, and the portion of the handle's `weights` (V,) that each gets."""
        if not _needs_counterparts(handle, edit):
            return [(self._own(handle), _portion(None, weights))]
        found = self.counterparts(edit, handle, band)
        counterparts = [one for one, _ in found]
        if handle.controls.counterparts == "only":
            return [(counterparts[0], _portion(counterparts[0].share, weights))]
        portions = [_portion(one.share, weights) for one in counterparts]
        if edit.rules.equalize:
            near = self.by_features.near(edit, handle, np.array([one.vertex for one in counterparts]))
            resting = [float(at_rest[one.vertex]) for one in counterparts]
            portions = _equalized(weights, counterparts, portions, near, resting)
        return [(one, portion) for (one, moves), portion in zip(found, portions, strict=True) if moves]


def _is_split(handle: Handle) -> bool:
    """Return whether each counterpart of a handle has its own column."""
    return handle.controls.counterparts != "shared_pivot"


def _needs_counterparts(handle: Handle, edit: Edit) -> bool:
    """Return whether the columns of a handle depend on its counterparts."""
    return _is_split(handle) or edit.rules.equalize or handle.controls.excluded_counterparts != ()


def _portion(share: Share | None, weights: Float32) -> Share:
    """Return the portion of a handle's `weights` (V,) that a counterpart with `share` gets."""
    if share is None:
        return _sparse(weights)
    return Share(share.vertices, weights[share.vertices] * share.values)


def _sum(portions: Sequence[Share], count: int) -> Share:
    """Return the sum of `portions` at each of `count` vertices, limited to 1."""
    if len(portions) == 1:
        return portions[0]
    total = np.zeros(count, np.float32)
    for portion in portions:
        total[portion.vertices] += portion.values
    return _sparse(np.minimum(total, np.float32(1.0)))


def _sparse(weights: Float32) -> Share:
    some = np.flatnonzero(weights)
    return Share(some, weights[some])


def _equalized(
    weights: Float32,
    counterparts: Sequence[Counterpart],
    portions: Sequence[Share],
    near: Float64,
    at_rest: Sequence[float],
) -> list[Share]:
    """Scale the `portions` of similar counterparts so that these move as much as the handle, except for locality.

    `near` (N,) are the factors of locality (Eq. 7) at the counterparts. These factors still lower the results.
    `at_rest` (N,) are the handle's weights at the counterparts while it is at rest. The sum of the results at a vertex
    is limited to the maximum of `weights`.
    """
    found = []
    own = 0.0
    total = np.zeros(len(weights), np.float32)
    for one, (vertices, values), falloff, weight in zip(counterparts, portions, near, at_rest, strict=True):
        top = weight / falloff if falloff > 0 else 0.0
        own = own or top
        alike = one.weight >= LEAST_ALIKE and top >= LEAST_EQUALIZED * own > 0
        found.append(Share(vertices, values * np.float32(own / top if alike else 1.0)))
        total[vertices] += found[-1].values
    most = weights.max(initial=0.0)
    if (total <= most).all():
        return found
    less = np.divide(most, total, out=np.ones_like(total), where=total > most)
    return [Share(vertices, values * less[vertices]) for vertices, values in found]
