"""Distances over the surface from a session's handles, and the falloff of Eq. 7 from them."""

from __future__ import annotations

import numpy as np

from dfd.common.linear_algebra import Float32
from dfd.editing.controls import Controls
from dfd.geometry.geodesics import Geodesics
from dfd.mesh.mesh import Mesh


class Distances:
    """Rows of distances on one mesh. A row is kept while a handle needs it."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._geodesics: dict[bool, Geodesics] = {}  # by whether they are exact, built at the first use
        self._rows: dict[tuple[bool, int], Float32] = {}  # rows (V,) by their source

    def falloff(self, sources: tuple[int, ...], controls: Controls, exact: bool) -> tuple[Float32 | None, float]:
        """Return distances G (1, V) in [0, 1] and λ of the falloff (1 − G)^λ of `controls`; (None, 0) without one.

        Distances start at the vertices `sources`. `exact` distances neither cross gaps between components nor use
        samples of a large mesh, as in the paper. With a radius r, G is min((d / r)², 1) and λ is 2. The falloff
        (1 − (d / r)²)² has slope 0 at the handle and at r, and is 0 beyond r.
        """
        if not sources:
            return None, 0.0
        geodesics = self._of(exact)
        for source in sources:
            if (exact, source) not in self._rows:
                self._rows[exact, source] = geodesics.distances([source])[0]
        nearest, *others = (self._rows[exact, source] for source in sources)
        for other in others:
            nearest = np.minimum(nearest, other)
        if controls.radius is None:
            return nearest[None], controls.locality
        reached = np.minimum(nearest * np.float32(geodesics.extent / controls.radius), np.float32(1.0))
        return np.square(reached)[None], 2.0

    def keep(self, sources: set[int]) -> None:
        """Delete the rows of all other sources, to free memory."""
        self._rows = {key: row for key, row in self._rows.items() if key[1] in sources}

    def _of(self, exact: bool) -> Geodesics:
        if exact not in self._geodesics:
            self._geodesics[exact] = Geodesics(self._mesh, bridges=not exact, sampled=not exact)
        return self._geodesics[exact]
