"""Compute weights by features, fixed points, distances and masks (Eq. 4 to 7): opened only if a handle needs them.

Of a handle that moves a part, these weights lower those of the part. Otherwise, they are the weights of the handle, and
each of its counterparts has a share of them. Nothing here depends on motions.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dfd.common.check import LARGEST
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, Fixed, Handle
from dfd.editing.points import Place
from dfd.editing.presets import PARTLESS_REACH
from dfd.editing.weights.fill import Column, Counterpart, whole
from dfd.editing.weights.handle_features import HandleFeatures
from dfd.editing.weights.held_part import HeldPart
from dfd.geometry.coarse import Share
from dfd.geometry.geodesics import Geodesics
from dfd.mesh.mesh import Mesh
from dfd.weights.bind import bind

# If fixed points leave a weight of at least LEAST_LEFT at a handle, all its weights are divided by this weight.
LEAST_LEFT = 0.01
# `equalize` raises the weights of a counterpart if, without the factor of locality, they are at least this fraction of
# those at the handle.
LEAST_EQUALIZED = 0.1
# If weights do not end at the part's border, each counterpart has a share of them at every mesh node.
SHARE_POWER = 2  # shares are proportional to 1 / distance ** SHARE_POWER, before the cutoff
SHARE_CUTOFF = 0.03  # at each mesh node, this fraction of the largest share is subtracted, and negative shares become 0


class Key(NamedTuple):
    """Cache key: everything that changes a column of weights by features."""

    place: Place
    controls: Controls  # the controls that change the column
    in_part: bool  # whether the weights end at a part's border, so that features do not lower them
    sources: tuple[int, ...]  # the vertices where geodesic distances start; empty without locality and radius
    exact: bool  # whether these distances are exact, see `_falloff`
    fixed: tuple[Fixed, ...]
    reach_targets: bool  # see `Rules.reach_targets`


class WeightsByFeatures:
    """The weights of handles on one mesh by features, fixed points, distances and masks."""

    def __init__(self, mesh: Mesh, rows: HandleFeatures) -> None:
        self._mesh, self._rows, self._kept = mesh, rows, rows.kept

    def columns(
        self, edit: Edit, number: int, held: HeldPart | None, own: Counterpart, *, equalize: bool
    ) -> list[Column]:
        """Return the column of each component of `held`; without a part, one column of the counterpart `own`.

        With `equalize`, similar counterparts move as much as the handle, except for locality and the mask.
        """
        handle = edit.handles[number]
        in_part = held is not None and handle.controls.reach == "part"
        weights = self.of(self.key(handle, edit, in_part=in_part))
        if held is None or (len(held.components) == 1 and not in_part):
            return [Column(number, own.vertex, own, _sparse(weights))]
        places = [each.counterpart for each in held.components]
        factors = [1.0] * len(places)
        if equalize and handle.controls.follow != "none":
            factors = self._equalizing(edit, handle, weights, places)
        if not in_part:
            everywhere = self._kept.get("shares", held, lambda: shares_everywhere(held, self._mesh.diagonal))
            shares = [Share(each.vertices, weights[each.vertices] * each.values) for each in everywhere]
            shares = _equalized(weights, shares, factors)
            return [Column(number, each.vertex, each, some) for each, some in zip(places, shares, strict=True)]
        most = weights.max(initial=0.0)
        lowered = (np.minimum(weights * np.float32(factor), most) for factor in factors)
        return [
            whole(number, each).scaled(lambda vertices, some=some: some[vertices])  # type: ignore[misc]
            for each, some in zip(held.components, lowered, strict=True)
        ]

    def of(self, key: Key) -> Float32:
        """Return a column (V,) of weights (Eq. 4 to 7)."""
        return self._kept.get("column", key, lambda: self._bound(key))

    def subtracted(self, fixed: tuple[Fixed, ...]) -> Float32:
        """Return the weight that fixed points p of strength s_p subtract at each vertex i, (V,): max_p s_p W_ip."""

        def find() -> Float32:
            most = np.zeros(len(self._mesh.vertices), np.float32)
            one = np.empty((len(most), 1), np.float32, order="F")
            for each in fixed:
                bind(self._rows.features, self._rows.points([each.place]), out=one)
                np.maximum(most, np.float32(each.strength) * one[:, 0], out=most)
                if each.place.region is not None:
                    own = self._rows.members(each.place.region)
                    most[own] = np.maximum(most[own], np.float32(each.strength))
            return most

        return self._kept.get("subtracted", fixed, find)

    def check_left(self, edit: Edit, handle: Handle) -> None:
        """Raise ValueError if fixed points leave a handle too little weight to reach its target."""
        left = self._left(edit.fixed, handle.place)
        if left < LEAST_LEFT:
            raise ArgumentError(
                "fixed",
                f"must leave handle {handle.id} at {handle.place} a weight of at least {LEAST_LEFT:g}, but leaves "
                f"{left:.2g}: a fixed point looks like the handle; lower its strength, or fix another place",
            )

    def _left(self, fixed: tuple[Fixed, ...], place: Place) -> float:
        """Return the weight of a handle at its own place, in [0, 1], after the subtraction of fixed points (Eq. 6)."""
        most = 0.0
        own = self._rows.of(place)
        for each in fixed:
            if self._rows.holds(each.place, place):
                most = max(most, each.strength)
            apart = np.linalg.norm(own[:, None] - self._rows.of(each.place)[None], axis=2)
            most = max(most, each.strength * (1.0 - float(apart.min(axis=1).max())))
        return 1.0 - most

    def key(self, handle: Handle, edit: Edit, *, in_part: bool) -> Key:
        """Return the key of a handle's column."""
        place, controls, exact = handle.place, handle.controls.of_column, edit.rules.exact_distances
        sources: list[int] = []
        if controls.locality > 0 or controls.radius is not None:
            own = self._rows.vertices(place)
            sources += own.tolist()
            if edit.symmetry is not None and not exact:  # a handle of a symmetric edit also acts at its mirror image
                points = [place.position] if place.region is None else self._mesh.vertices[own]
                sources += [self._rows.nearest((x, y, z)) for x, y, z in edit.symmetry.reflect(points).tolist()]
        starts = tuple(dict.fromkeys(sources))
        fixed = () if in_part and edit.rules.reach_targets else edit.fixed  # see `kept_by_fixed_points`
        return Key(place, controls, in_part, starts, exact and bool(starts), fixed, edit.rules.reach_targets)

    def _equalizing(
        self, edit: Edit, handle: Handle, weights: Float32, counterparts: Sequence[Counterpart]
    ) -> list[float]:
        """Return factors with which similar counterparts move as much as the handle, except for locality and the mask.

        `weights` (V,) are those of the handle. The factors of locality (Eq. 7) and of the mask still lower the results.
        """
        near = self.near(edit, handle, np.array([one.vertex for one in counterparts]))
        tops = [
            float(weights[one.vertex]) / nearness if nearness > 0 else 0.0
            for one, nearness in zip(counterparts, near, strict=True)
        ]
        return [tops[0] / top if top >= LEAST_EQUALIZED * tops[0] > 0 else 1.0 for top in tops]

    def near(self, edit: Edit, handle: Handle, vertices: Int64) -> Float64:
        """Return the factors (N,) by which distances (Eq. 7) and a mask lower weights at `vertices` (N,)."""
        distances, power = self._falloff(self.key(handle, edit, in_part=False))
        factors = np.ones(len(vertices))
        if distances is not None:
            factors *= (1.0 - distances[0, vertices].astype(np.float64)) ** power
        if handle.controls.mask is not None:
            factors *= self._rows.inside(handle.controls.mask, handle.controls.mask_feather)[vertices]
        return factors

    def _falloff(self, key: Key) -> tuple[Float32 | None, float]:
        """Return distances G (1, V), in [0, 1], and the exponent λ of Eq. 7, or (None, 0) if weights ignore distances.

        As in the paper, exact distances do not cross gaps between components of the mesh, and use all vertices instead
        of samples. For a radius r and distances d in mesh units, G is min((d / r)², 1) and λ is 2. Then the factor
        (1 − (d / r)²)² has slope 0 at the handle and at r, and is 0 beyond r.
        """
        exact, radius = key.exact, key.controls.radius
        if not key.sources:
            return None, 0.0
        geodesics = self._kept.get(
            "geodesics", exact, lambda: Geodesics(self._mesh, bridges=not exact, sampled=not exact)
        )

        def find() -> Float32:
            nearest = np.ones(len(self._mesh.vertices), np.float32)
            for source in key.sources:
                np.minimum(nearest, geodesics.distances([source])[0], out=nearest)
            return nearest

        nearest = self._kept.get("distances", (exact, key.sources), find)
        if radius is None:
            return nearest[None], key.controls.locality
        # The limit keeps the product with the distance 0 at the handle finite.
        factor = np.float32(min(geodesics.extent / radius, LARGEST))
        reached = np.minimum(nearest * factor, np.float32(1.0))
        return np.square(reached)[None], 2.0

    def _bound(self, key: Key) -> Float32:
        place, controls, fixed = key.place, key.controls, key.fixed
        # Inside a part, all weights must be 1. So the reach is much larger than all feature distances.
        of_part = LARGEST if key.in_part else PARTLESS_REACH
        reach = of_part if controls.reach == "part" else controls.reach
        geodesic, locality = self._falloff(key)
        column: Float32 = bind(
            self._rows.features,
            self._rows.points([place]),
            fixed=self._rows.points([each.place for each in fixed]) if fixed else None,
            strength=[each.strength for each in fixed] if fixed else None,
            geodesic=geodesic,
            locality=locality,
            reach=reach,
            falloff=controls.falloff,
        )[:, 0]
        # `bind` uses only some vertices of a region. Here, each vertex gets the weight of a handle at this vertex.
        if place.region is not None:
            own = self._rows.members(place.region)
            free = 1.0 - self.subtracted(fixed)[own] if fixed else np.float32(1.0)
            column[own] = np.maximum(column[own], free)
        for each in fixed:
            if each.place.region is not None:
                held = self._rows.members(each.place.region)
                column[held] = np.minimum(column[held], 1.0 - each.strength)
        if fixed and key.reach_targets:
            if place.region is not None:
                left = float(column[self._rows.members(place.region)].max())
            else:
                left = self._left(fixed, place) if place.vertex is None else float(column[place.vertex])
            if left >= LEAST_LEFT:
                np.minimum(column / np.float32(left), 1.0, out=column)
        column *= np.float32(controls.strength)
        if controls.mask is not None:
            column *= self._rows.inside(controls.mask, controls.mask_feather)
        return column


def _sparse(weights: Float32) -> Share:
    some = np.flatnonzero(weights)
    return Share(some, weights[some])


def _equalized(weights: Float32, shares: Sequence[Share], factors: Sequence[float]) -> list[Share]:
    """Multiply `shares` by `factors`. The sum of the results at a vertex is limited to the maximum of `weights`."""
    total = np.zeros(len(weights), np.float32)
    found = [
        Share(vertices, values * np.float32(factor)) for (vertices, values), factor in zip(shares, factors, strict=True)
    ]
    for vertices, values in found:
        total[vertices] += values
    most = weights.max(initial=0.0)
    if (total <= most).all():
        return found
    less = np.divide(most, total, out=np.ones_like(total), where=total > most)
    return [Share(vertices, values * less[vertices]) for vertices, values in found]


def shares_everywhere(held: HeldPart, diagonal: float) -> list[Share]:
    """Return the share of each counterpart at every vertex. It is 1 on the component of the counterpart.

    `diagonal` is that of the bounding box, in mesh units.
    """
    nodes, component = held.nodes, held.component_of_node
    components = [np.flatnonzero(component == number) for number in range(component.max(initial=0) + 1)]
    shares = np.empty((len(components), len(nodes.center)))
    for row, members in zip(shares, components, strict=True):
        distance = dijkstra(nodes.graph, indices=members, min_only=True)
        # Nodes without a path to the component get the straight distance plus the diagonal, so they count as farther.
        if len(apart := np.flatnonzero(np.isinf(distance) & nodes.used)):
            straight = cKDTree(nodes.center[members]).query(nodes.center[apart])[0]
            distance[apart] = straight + diagonal
        row[:] = (distance / diagonal + 1e-4) ** -SHARE_POWER
    shares[0, ~nodes.used] = 1.0
    shares /= shares.max(axis=0)
    shares -= SHARE_CUTOFF
    np.maximum(shares, 0.0, out=shares)
    shares /= shares.sum(axis=0)
    return nodes.shares(shares)
