"""Compute one column of weights for each handle from features (Eq. 4 to 7), and keep it until its inputs change."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, Fixed, Handle
from dfd.editing.influence.grips import Grips
from dfd.editing.influence.handle_features import HandleFeatures
from dfd.editing.influence.recent import Recent
from dfd.editing.points import Place
from dfd.editing.presets import LARGEST, PARTLESS_REACH
from dfd.geometry.geodesics import Geodesics
from dfd.mesh.mesh import Mesh
from dfd.segmentation.parts import AT_REST, Band
from dfd.weights.bind import bind

# If fixed points leave a weight of at least LEAST_LEFT at a handle, all its weights are divided by this weight.
LEAST_LEFT = 0.01
# As a number, the reach "part" is REACH_FACTOR times the REACH_QUANTILE quantile of the feature distances between the
# handle and the vertices of the part, and at least LEAST_REACH.
LEAST_REACH, REACH_QUANTILE, REACH_FACTOR = 0.1, 0.9, 2.0


class Key(NamedTuple):
    """Cache key: everything that changes a column of weights."""

    place: Place
    band: Band
    controls: Controls  # the controls that change the column
    sources: tuple[int, ...]  # the vertices where geodesic distances start; empty without locality and radius
    exact: bool  # whether these distances are exact, see `_falloff`
    fixed: tuple[Fixed, ...]
    reach_targets: bool  # see `Rules.reach_targets`


class FeatureWeights:
    """Compute and cache the weights of handles on one mesh.

    While a handle moves, its column changes only if its blend band gets another width. In the blend band, along the
    border of a part, weights fall from 1 to 0. New fixed points change all columns.
    """

    def __init__(self, mesh: Mesh, rows: HandleFeatures, grips: Grips) -> None:
        self._mesh, self._rows, self._grips = mesh, rows, grips
        self._columns = np.empty((0, len(mesh.vertices)), np.float32)  # (H, V), replaced if a column changes
        self._keys: list[Key] = []
        self._subtracted: Recent[Float32] = Recent(1)
        self._geodesics: dict[bool, Geodesics] = {}  # key: whether distances are exact
        self._distances: dict[tuple[bool, int], Float32] = {}  # (V,); keys: whether distances are exact, and the source
        self._reaches: dict[tuple[Place, int], float] = {}  # keys: the place and the level

    def of(self, edit: Edit, bands: Sequence[Band] | None = None) -> tuple[Float32, tuple[Key, ...]]:
        """Return the weights (V, H) of the handles of `edit`, read-only, and the key of each column.

        `bands` are the blend bands of the handles. If it is None, the handles' transforms determine them.
        """
        if bands is None:
            bands = [self._grips.band(handle) for handle in edit.handles]
        keys = [self.key(handle, edit, band) for handle, band in zip(edit.handles, bands, strict=True)]
        if keys != self._keys:
            row_of = {key: row for row, key in enumerate(self._keys)}
            columns = np.empty((len(keys), len(self._mesh.vertices)), np.float32)
            for key, row in zip(keys, columns, strict=True):
                if key in row_of:
                    row[:] = self._columns[row_of[key]]
                else:
                    self._bind(key, row)
            columns.flags.writeable = False
            self._keys, self._columns = keys, columns
            needed = {(key.exact, source) for key in keys for source in key.sources}
            self._distances = {source: row for source, row in self._distances.items() if source in needed}
        return self._columns.T, tuple(keys)

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

    def reach(self, handle: Handle) -> float:
        """Return the handle's `reach`. For "part", return a feature distance with a similar effect."""
        place, key = handle.place, (handle.place, handle.controls.level)
        if handle.controls.reach != "part":
            return handle.controls.reach
        if key not in self._reaches and (grip := self._grips.grip(*key)) is not None:
            # Unit vectors have a distance d of at most 2. So with a reach of 2, all weights are 1 − d / 2.
            apart = 2.0 * (1.0 - bind(self._rows.features, self._rows.points([place]), reach=2.0)[:, 0])
            within = apart[grip.weights > 0.5]
            widest = float(np.quantile(within, REACH_QUANTILE)) if len(within) else 0.0
            self._reaches[key] = min(max(REACH_FACTOR * widest, LEAST_REACH), 2.0)
        return self._reaches.get(key, PARTLESS_REACH)

    def near(self, edit: Edit, handle: Handle, vertices: Int64) -> Float64:
        """Return the factors (1 − G)^λ of Eq. 7, (N,), which lower the weights of a handle at `vertices` (N,)."""
        distances, power = self._falloff(self.key(handle, edit, AT_REST))  # distances do not depend on the band
        if distances is None:
            return np.ones(len(vertices))
        return (1.0 - distances[0, vertices].astype(np.float64)) ** power

    def check_targets(self, edit: Edit) -> None:
        """Raise ValueError if fixed points lower the weight at a handle so much that it cannot reach its target."""
        if not edit.rules.reach_targets or not edit.fixed:
            return
        for handle in edit.handles:
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

    def key(self, handle: Handle, edit: Edit, band: Band) -> Key:
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
        return Key(place, band, controls, starts, exact and bool(starts), edit.fixed, edit.rules.reach_targets)

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
        reached = np.minimum(nearest * np.float32(self._geodesics[exact].extent / radius), np.float32(1.0))
        return np.square(reached)[None], 2.0

    def _bind(self, key: Key, column: Float32) -> None:
        """Write the weights of a handle (Eq. 4 to 7) to `column` (V,)."""
        place, controls, fixed = key.place, key.controls, key.fixed
        part = self._grips.part(place, controls.level, key.band) if controls.reach == "part" else None
        # Inside a part, all weights must be 1. So the reach is much larger than all feature distances.
        of_part = PARTLESS_REACH if part is None else LARGEST
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
        if part is not None:
            column *= part
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
        if controls.strength < 1.0:
            column *= np.float32(controls.strength)
        if controls.mask is not None:
            column *= self._rows.inside(controls.mask, controls.mask_feather)
