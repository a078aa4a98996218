"""Distances over the surface from a session's handles, and the falloff of Eq. 7 from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float32, Int64
from dfd.editing.controls import Controls
from dfd.editing.points import Place
from dfd.posing.transforms import Vector

if TYPE_CHECKING:
    from dfd.geometry.geodesics import Geodesics
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

Indices = Int64


class Distances:
    """Rows of distances on one mesh. A row is kept while a handle needs it."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._geodesics: dict[bool, Geodesics] = {}  # by whether they are exact, built at the first use
        self._rows: dict[tuple[bool, int], Float32] = {}  # rows (V,) by their source
        self._found: dict[Vector, int] = {}  # nearest vertices, because every frame of a drag needs the same ones

    def sources(self, own: Indices, place: Place, symmetry: SymmetryPlane | None) -> tuple[int, ...]:
        """Return the vertices at which the distances of a handle at `place` start; `own` (N,) are its vertices.

        With a `symmetry` plane, distances also start at the handle's mirror image, because a symmetric edit acts there.
        """
        sources = dict.fromkeys(own.tolist())
        if symmetry is not None:
            points = [place.position] if place.region is None else self._mesh.vertices[own]
            for x, y, z in symmetry.reflect(points).tolist():
                sources[self._nearest((x, y, z))] = None
        return tuple(sources)

    def falloff(self, sources: tuple[int, ...], controls: Controls, exact: bool) -> tuple[Float32 | None, float]:
        """Return distances G (1, V) in [0, 1] and λ of the falloff (1 − G)^λ of `controls`; (None, 0) without one.

        `exact` distances neither cross gaps between components nor use samples of a large mesh, as in the paper.
        With a radius r, G is min((d / r)², 1) and λ is 2. The falloff (1 − (d / r)²)² has slope 0 at the handle and at
        r, and is 0 beyond r.
        """
        if not sources:
            return None, 0.0
        if controls.radius is None:
            return self._nearest_of(sources, exact)[None], controls.locality
        in_radii = np.float32(self.geodesics(exact).extent / controls.radius)
        reached = np.minimum(self._nearest_of(sources, exact) * in_radii, np.float32(1.0))
        return np.square(reached)[None], 2.0

    def keep(self, sources: set[int]) -> None:
        """Delete the rows of all other sources, to free memory."""
        self._rows = {key: row for key, row in self._rows.items() if key[1] in sources}

    def _nearest_of(self, sources: tuple[int, ...], exact: bool) -> Float32:
        """Return the distance (V,) in [0, 1] from the nearest of `sources`."""
        for source in sources:
            if (exact, source) not in self._rows:
                self._rows[exact, source] = self.geodesics(exact).distances([source])[0]
        nearest, *others = (self._rows[exact, source] for source in sources)
        for other in others:
            nearest = np.minimum(nearest, other)
        return nearest

    def _nearest(self, point: Vector) -> int:
        if point not in self._found:
            self._found[point] = int(np.linalg.norm(self._mesh.vertices - np.asarray(point), axis=1).argmin())
        return self._found[point]

    def geodesics(self, exact: bool) -> Geodesics:
        """Return the object that measures distances over the surface."""
        if exact not in self._geodesics:
            from dfd.geometry.geodesics import Geodesics  # slow to build, and needed only for locality

            self._geodesics[exact] = Geodesics(self._mesh, bridges=not exact, sampled=not exact)
        return self._geodesics[exact]
