"""Convert places to arguments of `dfd.bind`: vertex indices, or the features of points in space."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.kept import Kept
from dfd.common.linear_algebra import Float32, Int64
from dfd.editing.points import Place
from dfd.editing.regions import Region, distances_from, members
from dfd.field.field import Field, FieldOnMesh
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Vector
from dfd.weights.compact import CompactFeatures, compact

MOST_EXACT = 16_384  # meshes with more vertices have compact features, which save no time on smaller meshes
# At most 32 vertices with different features represent a region. They are chosen from at most 2,048 of its vertices.
MOST_REPRESENTATIVES, MOST_CANDIDATES = 32, 2048
SPARE = 32  # of each step, results for this many places are kept, for undo and for places under the pointer
# Fewer results are kept of steps with large ones. Each frame of a drag needs the same nearest vertices.
MOST = {"plan": 1, "weights": 1, "parts": 1, "column": 1, "subtracted": 1, "distances": 1, "shares": 2, "nearest": 64}


class HandleFeatures:
    """The features of vertices, regions and points in space on one mesh. The vertices' features are stored.

    `kept` is the cache of all steps that compute weights on this mesh.
    """

    def __init__(self, mesh: Mesh, field: Field, features: Any = None, *, full: bool = False) -> None:
        """Store `features` (V, D). If they are None, evaluate the field when features are first needed.

        With `full`, features are evaluated in full, even above `MOST_EXACT` vertices.

        Raises ValueError if `features` is not finite, or its array shape does not fit the mesh and the field.
        """
        shape = len(mesh.vertices), field.dimension
        if isinstance(features, CompactFeatures) and features.shape != shape:
            raise ArgumentError("features", f"must have shape {shape}, got {features.shape}", "Deformer")
        if features is not None and not isinstance(features, CompactFeatures):
            features = check.array("Deformer", "features", features, shape)
        self._mesh = mesh
        self._field = field
        self._on_mesh = FieldOnMesh(field, mesh)
        self._features: Float32 | CompactFeatures | None = features
        self._full = full
        self.kept = Kept(SPARE, **MOST)

    @property
    def features(self) -> Float32 | CompactFeatures:
        """Return the features (V, D). If not given, they are compact above 16,384 vertices, unless `full` is True."""
        self.prepare()
        assert self._features is not None
        return self._features

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Evaluate the features, unless they exist. `progress` gets the number of rows since its previous call."""
        if self._features is not None:
            return
        if len(self._mesh.vertices) > MOST_EXACT and not self._full:
            self._features = compact(self._on_mesh, progress=progress)
        else:
            self._features = self._field.features(self._mesh)
            if progress is not None:
                progress(len(self._features))

    def members(self, region: Region) -> Int64:
        """Return the vertices (N,) of a region."""
        return self.kept.get("members", region, lambda: members(self._mesh, region))

    def inside(self, region: Region, width: float) -> Float32:
        """Return a factor for each vertex, (V,): 1 in a region, falling smoothly to 0 at `width` mesh units from it."""
        inside = np.zeros(len(self._mesh.vertices), np.float32)
        if width == 0.0:
            inside[self.members(region)] = 1.0
            return inside
        with np.errstate(over="ignore"):
            left = np.maximum(1.0 - distances_from(self._mesh, region) / width, 0.0)
        return (left * left * (3.0 - 2.0 * left)).astype(np.float32)

    def representatives(self, region: Region) -> Int64:
        """Return at most 32 vertices of a region, (N,), whose features differ most from each other."""

        def find() -> Int64:
            chosen = self.members(region)
            candidates = chosen[:: -(-len(chosen) // MOST_CANDIDATES)]
            return candidates[_farthest_apart(self.of_vertices(candidates), MOST_REPRESENTATIVES)]

        return self.kept.get("representatives", region, find)

    def nearest(self, point: Vector) -> int:
        """Return the vertex nearest to a point (3,) in mesh units."""

        def find() -> int:
            return int(np.linalg.norm(self._mesh.vertices - np.asarray(point), axis=1).argmin())

        return self.kept.get("nearest", point, find)

    def vertices(self, place: Place) -> Int64:
        """Return vertices (N,) that represent a place: its vertex, the nearest vertex, or some vertices of a region."""
        if place.region is not None:
            return self.representatives(place.region)
        return np.array([self.nearest(place.position) if place.vertex is None else place.vertex])

    def anchor(self, place: Place) -> int:
        """Return one vertex for a place: its vertex, the nearest vertex, or the vertex nearest to a region's center."""
        if place.region is None:
            return int(self.vertices(place)[0])
        chosen = self.members(place.region)
        return int(chosen[np.linalg.norm(self._mesh.vertices[chosen] - np.asarray(place.position), axis=1).argmin()])

    def holds(self, place: Place, other: Place) -> bool:
        """Return whether `place` is a region that contains all vertices of `other`."""
        if place.region is None or (other.vertex is None and other.region is None):
            return False
        inner = np.array([other.vertex]) if other.region is None else self.members(other.region)
        return bool(np.isin(inner, self.members(place.region)).all())

    def points(self, places: Sequence[Place]) -> Any:
        """Return `places` as an argument of `bind`: vertices (N,), or features (N, D) if a place is a point in space.

        If a place is a region, return a list, which has the vertices or the features of each place.
        """
        known = [self.of(place) if _in_space(place) else self.vertices(place) for place in places]
        if any(place.region is not None for place in places):
            return known
        return np.concatenate([self.of(each) for each in places] if any(map(_in_space, places)) else known)

    def of(self, place: Place) -> Float32:
        """Return the features (N, D) of a place: one row, or for a region one row for each of its representatives."""
        if _in_space(place):
            return self._on_mesh.at(np.array([place.position]))
        return self.of_vertices(self.vertices(place))

    def of_vertices(self, vertices: Int64) -> Float32:
        """Return the features (N, D) of `vertices` (N,), without evaluating those of all vertices."""
        if self._features is None:
            return self._on_mesh.rows(vertices)
        if isinstance(self._features, CompactFeatures):
            return self._features.rows(vertices)
        return self._features[vertices]


def _in_space(place: Place) -> bool:
    """Return whether a place is a point in space, which has no vertex."""
    return place.region is None and place.vertex is None


def _farthest_apart(rows: Float32, most: int) -> Int64:
    """Return at most `most` indices (N,) of different `rows` (M, D), by farthest-point sampling."""
    chosen = [0]
    nearest = np.linalg.norm(rows - rows[0], axis=1)
    while len(chosen) < most and nearest.max() > 0:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(rows - rows[chosen[-1]], axis=1))
    return np.array(chosen)
