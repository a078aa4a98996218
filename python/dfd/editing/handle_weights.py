"""The weights of a session's handles: kept as long as what they depend on stays, bound when it does not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.editing.columns import Columns
from dfd.editing.edit import Edit, Handle, Place
from dfd.posing.transforms import Vector, vector
from dfd.weights.bind import bind
from dfd.weights.compact import CompactFeatures, compact

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.geometry.geodesics import Geodesics
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["HandleWeights"]

# As many vertices as `compact` would judge by: up to there it takes longer than it saves.
MOST_EXACT = 16_384

Float32 = NDArray[np.float32]


class Key(NamedTuple):
    """What a column of weights depends on, besides the fixed points."""

    place: Place
    locality: float
    sources: tuple[int, ...]  # the vertices where its distances start; none without locality


class HandleWeights:
    """Weights on one mesh, a contiguous column per handle.

    A handle that only moves keeps its column; a new one is bound behind the others, which are not touched; when one
    goes, those behind it move up; new fixed points cost all of them.

    Parameters
    ----------
    mesh, field
        The shape, and the field that is asked for features.
    features
        (V, D) features of the vertices, in full or compact; None asks the field when they are first needed.

    Raises
    ------
    ValueError
        If `features` is not finite or not one row of the field's width per vertex.
    """

    def __init__(self, mesh: Mesh, field: Field, features: Any = None) -> None:
        self._mesh = mesh
        self._field = field
        self._features = None if features is None else _checked(features, (len(mesh.vertices), field.dimension))
        self._columns = Columns(len(mesh.vertices))
        self._keys: list[Key] = []  # of the columns from 1 on
        self._fixed: tuple[Place, ...] = ()
        self._resting: bool | None = None  # whether the column of rest is one without D₀; None when it is out of date
        self._given: Float32 | None = None  # what `of` gave out last, as long as it holds
        self._distances: dict[int, Float32] = {}  # (V,) each, by the vertex they start at
        self._found: dict[Vector, int] = {}  # nearest vertices: every frame of a drag asks for the same ones

    @property
    def features(self) -> Float32 | CompactFeatures:
        """(V, D) features of the vertices: in full up to 16,384 vertices, compact beyond, or what was given."""
        self.prepare()
        assert self._features is not None
        return self._features

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Ask the field for the features, unless they are there; `progress` hears how many further rows are done."""
        if self._features is not None:
            return
        if len(self._mesh.vertices) > MOST_EXACT:
            self._features = compact(self._field, self._mesh.vertices, progress=progress)
        else:
            self._features = self._field.features(self._mesh)
            if progress is not None:
                progress(len(self._features))

    def of(self, edit: Edit) -> Float32:
        """(V, H) weights of the handles of `edit`, in their order; read-only, and nothing that follows changes it."""
        self._follow(edit)
        if self._given is None:
            self._given = self._columns.lend(1, 1 + len(self._keys))
        return self._given

    def blend_of(self, edit: Edit) -> Float32:
        """(V, H) or (V, 1 + H) weights to pose with: `of`, behind a handle that rests where there is more than one.

        Where look-alike handles sum to more than 1, Eq. 1 magnifies the shape about the origin, even when no handle
        moves. So one more handle rests, with a weight that takes away so much that they never do: a handle at rest
        then changes nothing anywhere, not by a bit, and handles that move add up. With a D₀, which gets what the sum
        leaves of 1, that weight is min(1 − Σ W, 0): where the sum is at most 1, it is Eq. 1 to the letter.
        """
        self._follow(edit)
        count = len(self._keys)
        if count < 2:
            return self._columns.between(1, 1 + count)
        without_default = edit.default is None
        if self._resting is not without_default:
            handles = self._columns.between(1, 1 + count)
            surplus = -float(count) if without_default else 1.0 - handles.sum(axis=1, dtype=np.float64)
            np.minimum(surplus, 0.0, out=self._columns.between(0, 1)[:, 0])
            self._resting = without_default
        return self._columns.between(0, 1 + count)

    def _follow(self, edit: Edit) -> None:
        """Have a column for each handle of `edit`, in their order: the first is 1."""
        if edit.fixed != self._fixed:
            self._keys, self._fixed = [], edit.fixed
        keys = [Key(handle.place, handle.locality, self._sources(handle, edit.symmetry)) for handle in edit.handles]
        if keys == self._keys:
            return
        column_of = {key: column for column, key in enumerate(self._keys, start=1)}
        self._keys, self._given, self._resting = [], None, None  # were binding to fail now, all are bound anew
        self._columns = self._columns.rearranged([column_of.get(key) for key in keys])
        runs: list[list[int]] = []  # of neighbours that one call can bind
        for column, key in enumerate(keys, start=1):
            if key in column_of:
                continue
            if runs and runs[-1][-1] == column - 1 and _alike(keys[column - 2], key):
                runs[-1].append(column)
            else:
                runs.append([column])
        for run in runs:
            first, last = run[0], run[-1] + 1
            self._bind(keys[first - 1 : last - 1], self._columns.between(first, last))
        self._keys = keys
        # The distances of handles that are gone are not worth their memory.
        living = {source for key in keys for source in key.sources}
        self._distances = {source: row for source, row in self._distances.items() if source in living}

    def _bind(self, keys: Sequence[Key], out: Float32) -> None:
        """Weights (V, N) of `keys`, all `_alike`, to `out` (Eq. 4 to 7)."""
        sources = keys[0].sources
        bind(
            self.features,
            self._points([key.place for key in keys]),
            fixed=self._points(self._fixed) if self._fixed else None,
            geodesic=self._distance(sources)[None] if sources else None,
            locality=[key.locality for key in keys],
            out=out,
        )

    def _points(self, places: Sequence[Place]) -> NDArray[np.int64] | Float32:
        """What `bind` takes for places: (N,) vertex indices, or (N, D) features where one of them is no vertex."""
        vertices = np.array([-1 if place.vertex is None else place.vertex for place in places])
        known = vertices >= 0
        if known.all():
            return vertices
        features = self.features
        rows = np.empty((len(places), features.shape[1]), np.float32)
        rows[~known] = self._field(np.array([place.position for place in places])[~known])
        if isinstance(features, CompactFeatures):
            rows[known] = features.rows(vertices[known])
        else:
            rows[known] = features[vertices[known]]
        return rows

    def _distance(self, sources: tuple[int, ...]) -> Float32:
        """(V,) distances in [0, 1] from the nearest of `sources`."""
        for source in sources:
            if source not in self._distances:
                self._distances[source] = self._geodesics.distances([source])[0]
        first, *others = (self._distances[source] for source in sources)
        return np.minimum(first, others[0]) if others else first

    def _sources(self, handle: Handle, symmetry: SymmetryPlane | None) -> tuple[int, ...]:
        """The vertices from which a handle's distances start; none for locality 0, which has no use for distances.

        A symmetric edit acts at the handle's mirror image as well, and what is near that is as near: measured from the
        handle alone, locality would undo the symmetry.
        """
        if handle.locality == 0:
            return ()
        place = handle.place
        source = self._nearest(place.position) if place.vertex is None else place.vertex
        if symmetry is None:
            return (source,)
        mirrored = self._nearest(vector("HandleWeights", "symmetry", symmetry.reflect([place.position])[0]))
        return (source,) if mirrored == source else (source, mirrored)

    def _nearest(self, point: Vector) -> int:
        if point not in self._found:
            self._found[point] = int(np.linalg.norm(self._mesh.vertices - np.asarray(point), axis=1).argmin())
        return self._found[point]

    @cached_property
    def _geodesics(self) -> Geodesics:
        from dfd.geometry.geodesics import Geodesics  # built for those who ask for locality, and for nobody else

        return Geodesics(self._mesh)


def _checked(features: Any, shape: tuple[int, int]) -> Float32 | CompactFeatures:
    if not isinstance(features, CompactFeatures):
        return check.array("Deformer", "features", features, shape)
    if features.shape != shape:
        raise ValueError(f"Deformer: `features` must have shape {shape}, got {features.shape}")
    return features


def _alike(one: Key, other: Key) -> bool:
    """Whether one call binds both: vertices and points are told to it in two ways, and distances only take memory."""
    return (one.place.vertex is None) == (other.place.vertex is None) and not one.sources and not other.sources
