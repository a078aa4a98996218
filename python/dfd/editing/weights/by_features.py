"""Compute one column of weights for each handle from features (Eq. 4 to 7), and keep it until its inputs change."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dfd.common.check import LARGEST
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, Fixed, Handle
from dfd.editing.weights.handle_features import HandleFeatures
from dfd.common.kept import Recent
from dfd.editing.points import Place
from dfd.editing.presets import PARTLESS_REACH
from dfd.geometry.geodesics import Geodesics
from dfd.mesh.mesh import Mesh
from dfd.weights.bind import bind

# If fixed points leave a weight of at least LEAST_LEFT at a handle, all its weights are divided by this weight.
LEAST_LEFT = 0.01


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
    """Compute and cache the weights of handles on one mesh by features, fixed points, distances and masks.

    They do not depend on motions. Of handles that move a part, they are the factors of the part's weights.
    """

    def __init__(self, mesh: Mesh, rows: HandleFeatures) -> None:
        self._mesh, self._rows = mesh, rows
        self._columns: dict[Key, Float32] = {}  # (V,)
        self._subtracted: Recent[Float32] = Recent(1)
        self._geodesics: dict[bool, Geodesics] = {}  # key: whether distances are exact
        self._distances: dict[tuple[bool, int], Float32] = {}  # (V,); keys: whether distances are exact, and the source

    def of(self, key: Key) -> Float32 | None:
        """Return a column (V,) of weights; None if all weights are 1."""
        if key.in_part and not key.sources and not key.fixed and key.controls.strength == 1.0 and not key.controls.mask:
            return None
        if key not in self._columns:
            column = np.empty(len(self._mesh.vertices), np.float32)
            self._bind(key, column)
            self._columns[key] = column
        return self._columns[key]

    def keep(self, keys: Sequence[Key]) -> None:
        """Forget all columns except those of `keys`."""
        self._columns = {key: column for key, column in self._columns.items() if key in keys}
        needed = {(key.exact, source) for key in keys for source in key.sources}
        self._distances = {source: row for source, row in self._distances.items() if source in needed}

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

        return self._subtracted.get(fixed, find)

    def near(self, edit: Edit, handle: Handle, vertices: Int64) -> Float64:
        """Return the factors (N,) by which distances (Eq. 7) and a mask lower weights at `vertices` (N,)."""
        distances, power = self._falloff(self.key(handle, edit, in_part=False))
        factors = np.ones(len(vertices))
        if distances is not None:
            factors *= (1.0 - distances[0, vertices].astype(np.float64)) ** power
        if handle.controls.mask is not None:
            factors *= self._rows.inside(handle.controls.mask, handle.controls.mask_feather)[vertices]
        return factors

    def check_targets(self, edit: Edit, handles: Sequence[Handle]) -> None:
        """Raise ValueError if fixed points of `edit` leave one of `handles` too little weight to reach its target."""
        for handle in handles:
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
        own = self._rows.of([place])
        for each in fixed:
            if self._rows.holds(each.place, place):
                most = max(most, each.strength)
            apart = np.linalg.norm(own[:, None] - self._rows.of([each.place])[None], axis=2)
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

    def _falloff(self, key: Key) -> tuple[Float32 | None, float]:
        """Return distances G (1, V), in [0, 1], and the exponent λ of Eq. 7, or (None, 0) if weights ignore distances.

        As in the paper, exact distances do not cross gaps between components of the mesh, and use all vertices instead
        of samples. For a radius r and distances d in mesh units, G is min((d / r)², 1) and λ is 2. Then the factor
        (1 − (d / r)²)² has slope 0 at the handle and at r, and is 0 beyond r.
        """
        exact, radius = key.exact, key.controls.radius
        if not key.sources:
            return None, 0.0
        if exact not in self._geodesics:
            self._geodesics[exact] = Geodesics(self._mesh, bridges=not exact, sampled=not exact)
        for source in key.sources:
            if (exact, source) not in self._distances:
                self._distances[exact, source] = self._geodesics[exact].distances([source])[0]
        nearest, *others = (self._distances[exact, source] for source in key.sources)
        for other in others:
            nearest = np.minimum(nearest, other)
        if radius is None:
            return nearest[None], key.controls.locality
        # The limit keeps the product with the distance 0 at the handle finite.
        factor = np.float32(min(self._geodesics[exact].extent / radius, LARGEST))
        reached = np.minimum(nearest * factor, np.float32(1.0))
        return np.square(reached)[None], 2.0

    def _bind(self, key: Key, column: Float32) -> None:
        """Write the weights of a handle (Eq. 4 to 7) to `column` (V,)."""
        place, controls, fixed = key.place, key.controls, key.fixed
        # Inside a part, all weights must be 1. So the reach is much larger than all feature distances.
        of_part = LARGEST if key.in_part else PARTLESS_REACH
        reach = of_part if controls.reach == "part" else controls.reach
        geodesic, locality = self._falloff(key)
        bind(
            self._rows.features,
            self._rows.points([place]),
            fixed=self._rows.points([each.place for each in fixed]) if fixed else None,
            strength=[each.strength for each in fixed] if fixed else None,
            geodesic=geodesic,
            locality=locality,
            reach=reach,
            falloff=controls.falloff,
            out=column[None].T,
        )
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
