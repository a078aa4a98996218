"""Find the part and the counterparts at a place, and keep the results of recent places."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from dfd.common.linear_algebra import Float32
from dfd.editing.edit import Handle
from dfd.editing.influence.counterparts import Held, find_counterparts
from dfd.editing.influence.handle_features import HandleFeatures
from dfd.editing.influence.recent import Recent
from dfd.editing.points import Place
from dfd.field.field import Field
from dfd.geometry.coarse import nodes_of
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import IDENTITY
from dfd.segmentation.parts import AT_REST, Band, Border, Grip, Parts
from dfd.symmetry.plane import SymmetryPlane
from dfd.symmetry.search import symmetry_planes
from dfd.weights.bind import bind


class Grips:
    """Find parts and counterparts at places on one mesh, and keep the results of recent places."""

    def __init__(self, mesh: Mesh, field: Field, rows: HandleFeatures) -> None:
        self._mesh, self._field, self._rows = mesh, field, rows
        self._parts: Recent[Grip | None] = Recent(32)  # while the pointer moves, many places need parts
        self._held: Recent[Held] = Recent(16)
        # A drag can move many handles. Each entry has 24 bytes per border point, or about 4 kB for 150 points.
        self._borders: Recent[Border | None] = Recent(1024)

    def prepare(self, planes: Sequence[SymmetryPlane], parts: Parts | None = None) -> Parts:
        """Compute all data that does not depend on a place, and return the parts of the mesh.

        A call takes seconds for a million faces, and may run on another thread. `planes` are the result of
        `symmetry_planes`. If this method ran in another session with this mesh and field, `parts` may be that result.
        """
        if parts is None:
            parts = self.parts
            parts.prepare()
            _ = nodes_of(self._mesh).tree
        self._planes, self.parts = list(planes), parts
        return parts

    @cached_property
    def parts(self) -> Parts:
        """Return the parts of the mesh."""
        return Parts(self._mesh, self._rows.of_vertices)

    @cached_property
    def _planes(self) -> list[SymmetryPlane]:
        return symmetry_planes(self._field, self._mesh)

    def grip(self, place: Place, level: int = 0, band: Band = AT_REST) -> Grip | None:
        """Return the part at a place, including all counterparts; None if there is no part, such as on a ball.

        In the blend band, a strip along the part's border, weights fall from 1 to 0. `level` is as in `Parts.part`.
        """
        key = (place, level, band)
        return self._parts.get(key, lambda: self.parts.grip(self._rows.anchor(place), level, band))

    def band(self, handle: Handle) -> Band:
        """Return the blend band of a handle's part."""
        if handle.controls.reach != "part" or np.array_equal(handle.matrix, IDENTITY):
            return AT_REST
        key = (handle.place, handle.controls.level)
        border = self._borders.get(key, lambda: None if (grip := self.grip(*key)) is None else grip.border)
        return AT_REST if border is None else border.band(handle.matrix)

    def held(
        self, place: Place, level: int, band: Band, *, everywhere: bool = False, plane: SymmetryPlane | None = None
    ) -> Held:
        """Return the part and the counterparts at a place. If given, `plane` replaces the shape's planes of symmetry.

        `level` is as in `Parts.part`, and `everywhere` as in `find_counterparts`.
        """

        def find() -> Held:
            rows, grip = self._rows, self.grip(place, level, band)
            weights: Float32 = bind(rows.features, rows.points([place]))[:, 0]
            planes = [] if grip is None else self._planes if plane is None else [plane]
            known = None if band == AT_REST else self.held(place, level, AT_REST, everywhere=everywhere, plane=plane)
            at, position = rows.anchor(place), place.position
            return find_counterparts(
                self._mesh, weights, at, position, grip, planes, everywhere=everywhere, known=known
            )

        return self._held.get((place, level, band, everywhere, plane), find)

    def part(self, place: Place, level: int, band: Band) -> Float32 | None:
        """Return the weights of the part at a place, (V,), or None if there is no part."""
        return None if self.grip(place, level, band) is None else self.held(place, level, band).part
