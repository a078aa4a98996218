"""The weights of a session's handles: kept as long as what they depend on stays, bound when it does not."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from dfd.bind import bind
from dfd.edit import Edit, Handle, Place

if TYPE_CHECKING:
    from dfd.field import Field
    from dfd.geodesics import Geodesics
    from dfd.mesh import Mesh

__all__ = ["HandleWeights"]

# What a column of weights depends on: the handle's place, its locality, the fixed points.
Key = tuple[Place, float, tuple[Place, ...]]


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
        keys: list[Key] = [(handle.place, handle.locality, edit.fixed) for handle in edit.handles]
        if keys == self._keys:
            return
        columns = {key: column for column, key in enumerate(self._keys)}
        kept = [i for i, key in enumerate(keys) if key in columns]
        missing = [i for i, key in enumerate(keys) if key not in columns]
        weights = self._bind([edit.handles[i] for i in missing], edit.fixed)
        if kept:
            bound, weights = weights, np.empty((len(self._mesh.vertices), len(keys)), np.float32)
            weights[:, missing] = bound
            weights[:, kept] = self._weights[:, [columns[keys[i]] for i in kept]]
        surplus = 1.0 - weights.sum(axis=1, dtype=np.float64)
        if (surplus < 0).any():
            self._blend = np.column_stack([weights, np.minimum(surplus, 0).astype(np.float32)])
            weights = self._blend[:, :-1]
        else:
            self._blend = weights
        self._blend.flags.writeable = weights.flags.writeable = False
        self._weights, self._keys = weights, keys
        self._forget_distances(edit)

    def _bind(self, handles: Sequence[Handle], fixed: Sequence[Place]) -> NDArray[np.float32]:
        """(V, H) weights, made anew (Eq. 4 to 7)."""
        if not handles:
            return np.zeros((len(self._mesh.vertices), 0), np.float32)
        locality = [handle.locality for handle in handles]
        weights = bind(
            self.features,
            self._rows([handle.place for handle in handles]),
            fixed=self._rows(fixed) if fixed else None,
            geodesic=self._geodesic(handles) if any(locality) else None,
            locality=locality,
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

    def _geodesic(self, handles: Sequence[Handle]) -> NDArray[np.float32]:
        """(H, V) distances in [0, 1]; 0 for handles of locality 0, which have no use for them."""
        rows = np.zeros((len(handles), len(self._mesh.vertices)), np.float32)
        sources = {row: self._source(handle.place) for row, handle in enumerate(handles) if handle.locality > 0}
        unknown = sorted(set(sources.values()) - self._distances.keys())
        if unknown:
            self._distances.update(zip(unknown, self._geodesics.distances(unknown), strict=True))
        for row, source in sources.items():
            rows[row] = self._distances[source]
        return rows

    def _forget_distances(self, edit: Edit) -> None:
        """Drop the distances of handles that are gone."""
        if self._distances:
            living = {self._source(handle.place) for handle in edit.handles if handle.locality > 0}
            self._distances = {source: row for source, row in self._distances.items() if source in living}

    def _source(self, place: Place) -> int:
        """The vertex from which a place's distances start: its own, or the nearest one."""
        if place.vertex is not None:
            return place.vertex
        return int(np.linalg.norm(self._mesh.vertices - np.asarray(place.position), axis=1).argmin())

    @cached_property
    def _geodesics(self) -> Geodesics:
        from dfd.geodesics import Geodesics  # built for those who ask for locality, and for nobody else

        return Geodesics(self._mesh)
