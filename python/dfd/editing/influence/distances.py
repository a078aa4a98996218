"""Distances over the surface from a session's handles, and the falloff that they make (Eq. 7)."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

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


class Measured(NamedTuple):
    """How distances are measured: the arguments of `Geodesics` of these names."""

    bridges: bool
    sampled: bool


class Distances:
    """Rows of distances on one mesh, kept as long as a handle starts there."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._geodesics: dict[Measured, Geodesics] = {}  # once they are asked for
        self._rows: dict[tuple[Measured, int], Float32] = {}  # (V,) each, by its source
        self._found: dict[Vector, int] = {}  # nearest vertices: every frame of a drag asks for the same ones

    def sources(self, own: Indices, place: Place, symmetry: SymmetryPlane | None) -> tuple[int, ...]:
        """The vertices from which the distances of a handle at `place`, with `own_pivot` vertices there, start.

        With a plane, `symmetry`, from the handle's mirror image as well: a symmetric edit acts there too, and locality
        that is measured from the handle alone undoes the symmetry.
        """
        sources = dict.fromkeys(own.tolist())
        if symmetry is not None:
            points = [place.position] if place.region is None else self._mesh.vertices[own]
            for x, y, z in symmetry.reflect(points).tolist():
                sources[self._nearest((x, y, z))] = None
        return tuple(sources)

    def falloff(self, sources: tuple[int, ...], controls: Controls, measured: Measured) -> tuple[Float32 | None, float]:
        """(1, V) distances in [0, 1] and the exponent λ that make the falloff (1 − G)^λ of `controls`; or neither.

        With a radius r, G is (d / r)² up to 1 and λ is 2: (1 − (d / r)²)², which is flat at the handle and at r, and
        0 beyond it.
        """
        if not sources:
            return None, 0.0
        if controls.radius is None:
            return self._nearest_of(sources, measured)[None], controls.locality
        in_radii = np.float32(self.geodesics(measured).extent / controls.radius)
        reached = np.minimum(self._nearest_of(sources, measured) * in_radii, np.float32(1.0))
        return np.square(reached)[None], 2.0

    def keep(self, sources: set[int]) -> None:
        """Forget the distances of handles that are gone: they are not worth their memory."""
        self._rows = {key: row for key, row in self._rows.items() if key[1] in sources}

    def _nearest_of(self, sources: tuple[int, ...], measured: Measured) -> Float32:
        """(V,) distances in [0, 1] from the nearest of `sources`."""
        for source in sources:
            if (measured, source) not in self._rows:
                self._rows[measured, source] = self.geodesics(measured).distances([source])[0]
        nearest, *others = (self._rows[measured, source] for source in sources)
        for other in others:
            nearest = np.minimum(nearest, other)
        return nearest

    def _nearest(self, point: Vector) -> int:
        if point not in self._found:
            self._found[point] = int(np.linalg.norm(self._mesh.vertices - np.asarray(point), axis=1).argmin())
        return self._found[point]

    def geodesics(self, measured: Measured) -> Geodesics:
        """Return what measures distances over the surface."""
        if measured not in self._geodesics:
            from dfd.geometry.geodesics import Geodesics  # slow to build, and needed for locality alone

            self._geodesics[measured] = Geodesics(self._mesh, **measured._asdict())
        return self._geodesics[measured]
