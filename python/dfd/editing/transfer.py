"""An edit carried from one shape to another of its class: handles go to what looks most like what they held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.editing.controls import Controls
from dfd.editing.door import door
from dfd.editing.edit import Edit, Handle
from dfd.editing.place import Place, place_on
from dfd.editing.regions import Ball, Box, HalfSpace, Part, Region, VertexSet, members
from dfd.editing.vertex_rows import VertexRows
from dfd.posing.transforms import Transform, Vector, vector
from dfd.symmetry.plane import SymmetryPlane
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

__all__ = ["Transferred", "transfer"]

# Among vertices whose features are as near as this to the nearest, the one at the most similar position is meant:
# features tell a leg from an arm, and hardly a left leg from a right one.
AS_NEAR = 0.1
MOST_POSITIONS = 2048  # of a set of vertices: more of them lie between these

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Transferred:
    """An edit on another shape, and how sure it is.

    Attributes
    ----------
    edit
        On the other mesh.
    confidence
        By handle id, in [0, 1]: the weight that the handle's old feature gives to where it is now, max(1 − d, 0).
    fixed_confidence
        The same for the fixed points, in their order.
    """

    edit: Edit
    confidence: dict[int, float]
    fixed_confidence: tuple[float, ...]


def transfer(edit: Edit, field_from: Field, mesh_to: Mesh, field_to: Field) -> Transferred:
    """Carry `edit` from the shape of one field to another shape of its class.

    A handle goes to the vertex whose feature is nearest to the handle's own, and among those that are about as near to
    the one at the most similar position in the box around the shape. Lengths (translations, pivots, radii) are scaled
    by the ratio of the longest sides; rotations and scales stay. Regions of space are carried from box to box, a set of
    vertices goes vertex by vertex (at most 2,048 of them, evenly chosen), a part is looked up by its name.

    Parameters
    ----------
    edit
        Made on the shape of `field_from`, in whose units it is.
    field_from, field_to
        Fields of the two shapes, of one encoder.
    mesh_to
        The other shape.

    Raises
    ------
    ValueError
        If the fields have features of different widths, two handles go to one vertex, or a region is empty there.
    """
    if field_from.dimension != field_to.dimension:
        raise ValueError(
            f"transfer: `field_to` must have features of width {field_from.dimension} as `field_from` has, "
            f"got {field_to.dimension}"
        )
    with door("transfer"):
        return _Carrier(field_from, mesh_to, field_to).carried(edit)


class _Carrier:
    def __init__(self, field_from: Field, mesh: Mesh, field_to: Field) -> None:
        self.field_from, self.mesh, self.field_to = field_from, mesh, field_to
        self.center_from, self.center_to = (field.center for field in (field_from, field_to))
        self.rows = VertexRows(mesh, field_to)
        self.ratio = float(field_from.scale) / float(field_to.scale)

    def carried(self, edit: Edit) -> Transferred:
        handles, confidence = [], {}
        for handle in edit.handles:
            place, confidence[handle.id] = self.place(handle.place)
            handles.append(self.handle(handle, place))
        fixed = [(replace(one, place=place), sure) for one in edit.fixed for place, sure in [self.place(one.place)]]
        carried = Edit(
            tuple(handles),
            tuple(one for one, _ in fixed),
            None if edit.symmetry is None else self.plane(edit.symmetry),
            None if edit.default is None else self.transform(edit.default, self.point),
            edit.overlap,
            edit.blend,
            edit.arrive,
        )
        return Transferred(carried, confidence, tuple(sure for _, sure in fixed))

    def point(self, position: Vector) -> Vector:
        """Where a point lies in the box around the other shape."""
        return vector("position", self.center_to + self.ratio * (np.asarray(position) - self.center_from))

    def place(self, place: Place) -> tuple[Place, float]:
        """Where a place is on the other shape, and how sure that is."""
        if place.region is None:
            vertices, apart = self.nearest(np.array([place.position]))
            return place_on(self.mesh, int(vertices[0])), _sure(apart)
        if isinstance(place.region, VertexSet):
            vertices, apart = self.nearest(place.region.positions)
            return place_on(self.mesh, VertexSet.of(self.mesh, np.unique(vertices))), _sure(apart)
        carried = self.region(place.region)
        held = self.mesh.vertices[members(self.mesh, carried)].mean(axis=0, keepdims=True)
        apart = np.linalg.norm(self.field_from(np.array([place.position])) - self.field_to(held), axis=1)
        return place_on(self.mesh, carried), _sure(apart)

    def region(self, region: Region) -> Region:
        """A region of the other shape."""
        match region:
            case Ball():
                return Ball(self.point(region.center), self.ratio * region.radius)
            case Box():
                return Box(self.point(region.low), self.point(region.high))
            case HalfSpace():
                on_plane = self.point(vector("normal", region.offset * np.asarray(region.normal)))
                return HalfSpace(region.normal, float(np.dot(on_plane, region.normal)))
            case Part():
                return region
            case VertexSet():
                return VertexSet.of(self.mesh, np.unique(self.nearest(region.positions)[0]))

    def handle(self, handle: Handle, place: Place) -> Handle:
        """The handle at its new place; its pivot lies from it as before, in units of the other shape."""

        def beside(pivot: Vector) -> Vector:
            offset = np.subtract(pivot, handle.place.position)
            return vector("pivot", np.asarray(place.position) + self.ratio * offset)

        controls = handle.controls
        carried: Controls = replace(
            controls,
            radius=None if controls.radius is None else self.ratio * controls.radius,
            within_width=self.ratio * controls.within_width,
            without_instances=(),  # the other shape has other ones
            within=None if controls.within is None else self.region(controls.within),
        )
        return replace(handle, place=place, transform=self.transform(handle.transform, beside), controls=carried)

    def transform(self, transform: Transform, move: Callable[[Vector], Vector]) -> Transform:
        """The transform in units of the other shape."""
        return replace(
            transform,
            translation=vector("translation", self.ratio * np.asarray(transform.translation)),
            pivot=None if transform.pivot is None else move(transform.pivot),
        )

    def plane(self, plane: SymmetryPlane) -> SymmetryPlane:
        """The plane in the box around the other shape."""
        on_plane = self.point(vector("normal", plane.offset * np.asarray(plane.normal)))
        offset = float(np.dot(on_plane, plane.normal))
        return SymmetryPlane(plane.normal, offset, band=self.ratio * plane.band)

    def nearest(self, positions: Points) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(N,) the vertices that look most like points of the first shape, and how far their features are apart."""
        chosen = positions[:: -(-len(positions) // MOST_POSITIONS)]
        wanted = self.field_from(chosen)
        meant = self.center_to + self.ratio * (chosen - self.center_from)
        vertices, apart = np.empty(len(chosen), np.int64), np.empty(len(chosen))
        for i, row in enumerate(wanted):
            # With twice the paper's reach, no distance of unit features is cut off.
            distances = 2.0 * (1.0 - bind(self.rows.features, row[None], reach=2.0)[:, 0])
            alike = np.flatnonzero(distances <= distances.min() + AS_NEAR)
            vertices[i] = alike[np.linalg.norm(self.mesh.vertices[alike] - meant[i], axis=1).argmin()]
            apart[i] = distances[vertices[i]]
        return vertices, apart


def _sure(apart: NDArray[np.floating]) -> float:
    """The confidence that features so far apart give: the mean of the weights that they make (Eq. 5)."""
    return float(np.maximum(1.0 - apart, 0.0).mean())
