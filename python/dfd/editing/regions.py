"""Regions of a mesh: a ball, a box, one side of a plane, a part of the scene, a face group, or a set of vertices.

A region stores its geometry or a name. It therefore selects the same surface on other meshes of the same shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from dfd.common import check
from dfd.common.described import About, Written, check_fields
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.common.read_only import ReadOnlyArrays
from dfd.posing.transforms import Vector

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

# Positions count as equal up to this fraction of the bounding box's diagonal, because files store 32-bit floats.
SAME_POSITION = 1e-5
# On a finer mesh, a vertex belongs to a `VertexSet` if its distance from the nearest position of the set is below this
# fraction of the set's median spacing.
NEAR_SPACING = 0.8


class RegionBase:
    """The base class of regions, which checks their fields. Messages contain the `str` of a region."""

    def __post_init__(self) -> None:
        check_fields(self)

    def away(self, points: Float64) -> Float64:
        """Return the distances (N,) of `points` (N, 3) from the region, in mesh units. Inside, values are at most 0."""
        raise NotImplementedError

    def inside(self, mesh: Mesh) -> Bool:
        """Return which vertices (V,) of `mesh` belong to the region."""
        return self.away(mesh.vertices) <= 0


@dataclass(frozen=True)
class Ball(RegionBase):
    """All vertices at a distance of at most `radius` from `center`, in mesh units."""

    center: Annotated[Vector, About("Mesh units.", unit="position")]
    radius: Annotated[float, About("Mesh units.", 0.0, exclusive=True, unit="length")]
    kind: Literal["ball"] = field(default="ball", repr=False)

    def __str__(self) -> str:
        return f"the ball of radius {self.radius:g} around {_point(self.center)}"

    def away(self, points: Float64) -> Float64:
        return np.linalg.norm(points - np.asarray(self.center), axis=1) - self.radius


@dataclass(frozen=True)
class Box(RegionBase):
    """All vertices in the axis-aligned box between the corners `low` and `high`, in mesh units."""

    low: Annotated[Vector, About("Mesh units.", unit="position")]
    high: Annotated[Vector, About("Mesh units.", unit="position")]
    kind: Literal["box"] = field(default="box", repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if any(low > high for low, high in zip(self.low, self.high, strict=True)):
            raise ArgumentError("low", f"must not exceed `high`, got {self.low} and {self.high}", "Box")

    def __str__(self) -> str:
        return f"the box from {_point(self.low)} to {_point(self.high)}"

    def away(self, points: Float64) -> Float64:
        outside = np.maximum(np.asarray(self.low) - points, points - np.asarray(self.high))
        return np.linalg.norm(np.maximum(outside, 0.0), axis=1)


@dataclass(frozen=True)
class HalfSpace(RegionBase):
    """All vertices p with normal · p ≥ offset, in mesh units. Both fields are divided by the length of `normal`."""

    normal: Vector
    offset: Annotated[float, About("Mesh units.")]
    kind: Literal["half_space"] = field(default="half_space", repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        length = math.hypot(*self.normal)
        if length == 0.0:
            raise ArgumentError("normal", f"must have a length, got {self.normal}", "HalfSpace")
        if abs(length - 1.0) > 1e-12:  # a region that is written to a file and read keeps its exact values
            object.__setattr__(self, "normal", tuple(component / length for component in self.normal))
            object.__setattr__(self, "offset", self.offset / length)
        check.bounded("HalfSpace", "offset", (self.offset,))

    def __str__(self) -> str:
        return f"the side {_point(self.normal)} · p ≥ {self.offset:g}"

    def away(self, points: Float64) -> Float64:
        return self.offset - points @ np.asarray(self.normal)


@dataclass(frozen=True)
class Part(RegionBase):
    """All vertices of the part `name` of the scene, else of the geometry, else of the material with this name."""

    name: str
    kind: Literal["part"] = field(default="part", repr=False)

    def __str__(self) -> str:
        return f"part:{self.name}"

    def inside(self, mesh: Mesh) -> Bool:
        return _mask(mesh, mesh.part_vertices(self.name))


@dataclass(frozen=True)
class Group(RegionBase):
    """All vertices of a face group of an OBJ file, by the name in a `g`, `o` or `usemtl` line."""

    name: str
    kind: Literal["group"] = field(default="group", repr=False)

    def __str__(self) -> str:
        return f"group:{self.name}"

    def inside(self, mesh: Mesh) -> Bool:
        return _mask(mesh, mesh.group_vertices(self.name))


@dataclass(frozen=True, eq=False)
class VertexSet(ReadOnlyArrays):
    """A set of vertices, with their positions on the mesh on which they were chosen.

    On another mesh, the set contains the vertices nearest to these positions; on a finer mesh, also those in between.

    Raises ValueError if `indices` is empty or contains a vertex twice, or if `positions` has another length.
    """

    indices: Annotated[Int64, Written(list[int])]  # (N,) distinct vertex indices, ascending
    positions: Annotated[Float64, Written(list[Vector])]  # (N, 3) in mesh units
    count: int | None = None  # vertex count of the mesh on which the set was chosen; None if unknown
    kind: Literal["vertices"] = field(default="vertices", repr=False)

    def __post_init__(self) -> None:
        chosen = check.vertex_indices(
            "VertexSet", "indices", self.indices, np.iinfo(np.int32).max, unique=True, wrap=False
        )
        if len(chosen) == 0:
            raise ArgumentError("indices", "must name at least one vertex", "VertexSet")
        placed = check.array("VertexSet", "positions", self.positions, (len(chosen), 3), dtype=np.float64)
        check.bounded("VertexSet", "positions", (float(np.abs(placed).max()),))
        order = np.argsort(chosen)
        for name, values in (("indices", chosen[order]), ("positions", placed[order])):
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    @classmethod
    def of(cls, mesh: Mesh, chosen: Any) -> VertexSet:
        """Return the set of the `chosen` vertices of `mesh`: indices (N,), or a mask (V,) bool."""
        values = np.asarray(chosen)
        if values.dtype == bool:
            values = np.flatnonzero(check.array("VertexSet", "indices", values, (len(mesh.vertices),), dtype=bool))
        indices = np.unique(check.vertex_indices("VertexSet", "indices", values, len(mesh.vertices)))
        return cls(indices, mesh.vertices[indices], len(mesh.vertices))

    @cached_property
    def _identity(self) -> tuple[bytes, bytes]:
        return self.indices.tobytes(), self.positions.tobytes()

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, VertexSet) and self._identity == other._identity)

    def __hash__(self) -> int:
        return hash(self._identity)

    def __repr__(self) -> str:
        return f"VertexSet({len(self.indices)} vertices)"

    def __str__(self) -> str:
        count = len(self.indices)
        return f"a set of {count} {'vertex' if count == 1 else 'vertices'}"

    def inside(self, mesh: Mesh) -> Bool:
        if self.lies_on(mesh):
            return _mask(mesh, self.indices)
        from scipy.spatial import cKDTree  # slow to import, and not needed for the command-line help

        apart, nearest = cKDTree(mesh.vertices).query(self.positions)
        inside = _mask(mesh, nearest)
        reordered = self.count == len(mesh.vertices) and apart.max() <= SAME_POSITION * mesh.diagonal
        if not reordered and len(self.positions) > 1:
            tree = cKDTree(self.positions)
            spacing = float(np.median(tree.query(self.positions, k=2)[0][:, 1]))
            inside |= np.isfinite(tree.query(mesh.vertices, distance_upper_bound=NEAR_SPACING * spacing)[0])
        return inside

    def lies_on(self, mesh: Mesh) -> bool:
        """Return whether the vertices of `mesh` with the indices of the set have the positions of the set."""
        if self.indices[-1] >= len(mesh.vertices):
            return False
        apart = np.linalg.norm(mesh.vertices[self.indices] - self.positions, axis=1)
        return bool(apart.max() <= SAME_POSITION * mesh.diagonal)


Region = Ball | Box | Group | HalfSpace | Part | VertexSet


def members(mesh: Mesh, region: Region) -> Int64:
    """Return the vertices (N,) of `mesh` in `region`, ascending. Raises ValueError if there are none."""
    try:
        found = np.flatnonzero(region.inside(mesh))
    except ArgumentError as error:  # The name is unknown. The message must name the argument `region`.
        raise ArgumentError("region", error.reason) from None
    if len(found) == 0:
        raise ArgumentError("region", f"must hold a vertex, but {region} holds none of the mesh's {len(mesh.vertices)}")
    return found


def distances_from(mesh: Mesh, region: Region) -> Float64:
    """Return the distances (V,) of all vertices from `region`, mesh units. Raises ValueError if it holds no vertex."""
    from scipy.spatial import cKDTree

    inside = members(mesh, region)
    if isinstance(region, Ball | Box | HalfSpace):
        return np.maximum(region.away(mesh.vertices), 0.0)
    # Other regions are sets of vertices, so the distance is that from the nearest vertex of the region.
    return np.asarray(cKDTree(mesh.vertices[inside]).query(mesh.vertices)[0])


def _mask(mesh: Mesh, vertices: Any) -> Bool:
    """Return the mask (V,) that is True for `vertices` (N,)."""
    mask = np.zeros(len(mesh.vertices), bool)
    mask[vertices] = True
    return mask


def _point(position: Vector) -> str:
    return "(" + ", ".join(f"{x:g}" for x in position) + ")"
