"""The weights of a session's handles: kept as long as what they depend on stays, bound when it does not."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from dfd.bind import bind
from dfd.editing.edit import Edit, Handle, Place
from dfd.editing.transforms import Vector, vector

if TYPE_CHECKING:
    from dfd.field import Field
    from dfd.geodesics import Geodesics
    from dfd.mesh import Mesh
    from dfd.symmetry import SymmetryPlane

__all__ = ["HandleWeights"]

# What a column of weights depends on: the handle's place and locality, the fixed points, where its distances start.
Key = tuple[Place, float, tuple[Place, ...], tuple[int, ...]]


class HandleWeights:
    """Weights on one mesh, a column per handle.

    A handle that only moves keeps its column, a new one costs one column, and new fixed points cost all of them.

    Parameters
    ----------
    mesh, field
        The shape, and the field that is asked for features.
    features
        (V, D) float32 features of the vertices; None asks the field when they are first needed.
    """

    def __init__(self, mesh: Mesh, field: Field, features: NDArray[np.float32] | None) -> None:
        self._mesh = mesh
        self._field = field
        if features is not None:
            self.features = features
        self._keys: list[Key] = []
        self._weights = self._blend = np.zeros((len(mesh.vertices), 0), np.float32)
        self._distances: dict[int, NDArray[np.float32]] = {}  # (V,) each, by the vertex they start at
        self._found: dict[Vector, int] = {}  # nearest vertices: every frame of a drag asks for the same ones

    @cached_property
    def features(self) -> NDArray[np.float32]:
        """(V, D) features of the vertices."""
        return self._field.features(self._mesh)

    def of(self, edit: Edit) -> NDArray[np.float32]:
        """(V, H) weights of the handles of `edit`, in their order; read-only."""
        self._follow(edit)
        return self._weights

    def blend_of(self, edit: Edit) -> NDArray[np.float32]:
        """(V, H) or (V, H + 1) weights to pose with: `of`, and a resting handle where that needs one; read-only.

        Eq. 1 gives what the weights leave of 1 to D₀. Where look-alike handles sum to more than 1 they leave nothing,
        and Eq. 1 then magnifies the shape about the origin, even when no handle moves. So there the surplus 1 − Σ W is
        the (negative) weight of one more handle that rests: a handle at rest changes nothing anywhere, handles that
        move add up, and where the sum is at most 1 it is Eq. 1 to the letter.
        """
        self._follow(edit)
        return self._blend

    def _follow(self, edit: Edit) -> None:
        keys: list[Key] = [
            (handle.place, handle.locality, edit.fixed, self._sources(handle, edit.symmetry)) for handle in edit.handles
        ]
        if keys == self._keys:
            return
        columns = {key: column for column, key in enumerate(self._keys)}
        kept = [i for i, key in enumerate(keys) if key in columns]
        missing = [i for i, key in enumerate(keys) if key not in columns]
        old = self._weights[:, _as_slice([columns[keys[i]] for i in kept])]
        new = self._bind([keys[i] for i in missing])
        surplus = 1.0 - old.sum(axis=1, dtype=np.float64) - new.sum(axis=1, dtype=np.float64)
        crowded = bool((surplus < 0).any())
        if kept or crowded:
            self._blend = np.empty((len(surplus), len(keys) + crowded), np.float32)
            self._blend[:, _as_slice(kept)] = old
            self._blend[:, _as_slice(missing)] = new
            self._blend[:, len(keys) :] = np.minimum(surplus, 0)[:, None]
        else:
            self._blend = new
        self._blend.flags.writeable = False
        self._weights, self._keys = self._blend[:, : len(keys)], keys
        # The distances of handles that are gone are not worth their memory.
        living = {source for *_, sources in keys for source in sources}
        self._distances = {source: row for source, row in self._distances.items() if source in living}

    def _bind(self, keys: Sequence[Key]) -> NDArray[np.float32]:
        """(V, H) weights, made anew (Eq. 4 to 7)."""
        if not keys:
            return np.zeros((len(self._mesh.vertices), 0), np.float32)
        places, localities, (fixed, *_), sources = zip(*keys, strict=True)
        weights = bind(
            self.features,
            self._rows(places),
            fixed=self._rows(fixed) if fixed else None,
            geodesic=self._geodesic(sources) if any(sources) else None,
            locality=localities,
        )
        return cast("NDArray[np.float32]", weights)

    def _rows(self, places: Sequence[Place]) -> NDArray[np.float32]:
        """(N, D) features of places."""
        rows = np.empty((len(places), self.features.shape[1]), np.float32)
        points = [i for i, place in enumerate(places) if place.vertex is None]
        for row, place in zip(rows, places, strict=True):
            if place.vertex is not None:
                row[:] = self.features[place.vertex]
        if points:
            rows[points] = self._field(np.array([places[i].position for i in points]))
        return rows

    def _geodesic(self, sources: Sequence[tuple[int, ...]]) -> NDArray[np.float32]:
        """(H, V) distances in [0, 1] from the nearest of each handle's sources; 0 for a handle without any."""
        unknown = sorted({source for several in sources for source in several} - self._distances.keys())
        if unknown:
            self._distances.update(zip(unknown, self._geodesics.distances(unknown), strict=True))
        rows = np.zeros((len(sources), len(self._mesh.vertices)), np.float32)
        for row, several in zip(rows, sources, strict=True):
            if several:
                np.minimum.reduce([self._distances[source] for source in several], out=row)
        return rows

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
        from dfd.geodesics import Geodesics  # built for those who ask for locality, and for nobody else

        return Geodesics(self._mesh)


def _as_slice(columns: list[int]) -> slice | list[int]:
    """A slice where neighbours follow each other, as after adding a handle: many times faster to copy by."""
    if columns == list(range(columns[0] if columns else 0, columns[-1] + 1 if columns else 0)):
        return slice(columns[0], columns[-1] + 1) if columns else slice(0, 0)
    return columns
