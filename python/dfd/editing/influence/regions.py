"""Sets of vertices, as people name them: a ball, a box, one side of a plane, a part of the scene, a face group, a
list of vertices.

A region is kept as what was said and not as what it held, so that it means the same on another resolution of the shape.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.described import About, Written, check_fields
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.posing.transforms import Vector, vector

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

# A vertex that moved by no more than this part of the box's diagonal is the same one: files round positions to float32.
SAME_POSITION = 1e-5

# On a finer mesh, what lies nearer to a vertex of a set than this part of their spacing belongs to the set.
NEAR_SPACING = 0.8

Indices = Int64
Mask = Bool


@dataclass(frozen=True)
class Ball:
    """What lies within `radius` of `center`, mesh units."""

    center: Vector
    radius: Annotated[float, About("Mesh units.", 0.0, exclusive=True)]
    kind: Literal["ball"] = field(default="ball", repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", vector("center", self.center))
        check_fields(self)

    def __str__(self) -> str:
        """Name it for a message."""
        return f"the ball of radius {self.radius:g} around {_point(self.center)}"

    def inside(self, mesh: Mesh) -> Mask:
        """(V,) which vertices lie in it."""
        return np.linalg.norm(mesh.vertices - np.asarray(self.center), axis=1) <= self.radius


@dataclass(frozen=True)
class Box:
    """What lies between two corners, mesh units."""

    low: Vector
    high: Vector
    kind: Literal["box"] = field(default="box", repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", vector("low", self.low))
        object.__setattr__(self, "high", vector("high", self.high))
        if any(low > high for low, high in zip(self.low, self.high, strict=True)):
            raise ArgumentError("low", f"must not exceed `high`, got {self.low} and {self.high}", "Box")

    def __str__(self) -> str:
        """Name it for a message."""
        return f"the box from {_point(self.low)} to {_point(self.high)}"

    def inside(self, mesh: Mesh) -> Mask:
        """(V,) which vertices lie in it."""
        low, high = np.asarray(self.low), np.asarray(self.high)
        return np.all((mesh.vertices >= low) & (mesh.vertices <= high), axis=1)


@dataclass(frozen=True)
class HalfSpace:
    """One side of a plane: every p with normal · p ≥ offset, mesh units; `normal` gets unit length."""

    normal: Vector
    offset: float
    kind: Literal["half_space"] = field(default="half_space", repr=False)

    def __post_init__(self) -> None:
        normal = vector("normal", self.normal)
        length = float(np.linalg.norm(normal))
        if length == 0.0:
            raise ArgumentError("normal", f"must have a length, got {normal}", "HalfSpace")
        x, y, z = (component / length for component in normal)
        object.__setattr__(self, "normal", (x, y, z))
        object.__setattr__(self, "offset", check.number("HalfSpace", "offset", self.offset) / length)

    def __str__(self) -> str:
        """Name it for a message."""
        return f"the side {_point(self.normal)} · p ≥ {self.offset:g}"

    def inside(self, mesh: Mesh) -> Mask:
        """(V,) which vertices lie in it."""
        return mesh.vertices @ np.asarray(self.normal) >= self.offset


@dataclass(frozen=True)
class Named:
    """What has a name in the mesh's file."""

    name: str

    def __post_init__(self) -> None:
        name: object = self.name
        if not isinstance(name, str) or not name:
            raise ArgumentError("name", f"must be a text that is not empty, got {self.name!r}", type(self).__name__)


@dataclass(frozen=True)
class Part(Named):
    """A part of the mesh's scene, by its name."""

    kind: Literal["part"] = field(default="part", repr=False)

    def __str__(self) -> str:
        """Name it for a message."""
        return f"part:{self.name}"

    def inside(self, mesh: Mesh) -> Mask:
        """(V,) which vertices belong to it."""
        return _mask(mesh, mesh.part_vertices(self.name))


@dataclass(frozen=True)
class Group(Named):
    """The faces of an OBJ file's group, by its name: that of a `g`, `o` or `usemtl` line."""

    kind: Literal["group"] = field(default="group", repr=False)

    def __str__(self) -> str:
        """Name it for a message."""
        return f"group:{self.name}"

    def inside(self, mesh: Mesh) -> Mask:
        """(V,) which vertices belong to it."""
        return _mask(mesh, mesh.group_vertices(self.name))


@dataclass(frozen=True, eq=False)
class VertexSet:
    """A list of vertices, with where they lie on the shape on which they were chosen.

    On another mesh, those nearest to them belong to it, and on a finer one what lies between them.

    Raises ValueError if there is none, one occurs twice, or there are not as many positions.
    """

    indices: Annotated[Indices, Written(list[int])]  # (N,) vertex indices, once each, ascending
    positions: Annotated[Float64, Written(list[Vector])]  # (N, 3) in mesh units
    count: int | None = None  # how many vertices that shape has; None where nobody knows
    kind: Literal["vertices"] = field(default="vertices", repr=False)

    def __post_init__(self) -> None:
        chosen = check.vertex_indices("VertexSet", "indices", self.indices, np.iinfo(np.int32).max, unique=True)
        if len(chosen) == 0:
            raise ArgumentError("indices", "must name at least one vertex", "VertexSet")
        placed = check.array("VertexSet", "positions", self.positions, (len(chosen), 3), dtype=np.float64)
        order = np.argsort(chosen)
        for name, values in (("indices", chosen[order]), ("positions", placed[order])):
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    @classmethod
    def of(cls, mesh: Mesh, chosen: Any) -> VertexSet:
        """The vertices of `mesh` that `chosen` names: (N,) indices, or a mask of (V,) truth values."""
        values = np.asarray(chosen)
        if values.dtype == bool:
            mask = check.array("VertexSet", "indices", values, (len(mesh.vertices),), dtype=bool)
            values = np.flatnonzero(mask)
        indices = np.unique(check.vertex_indices("VertexSet", "indices", values, len(mesh.vertices)))
        return cls(indices, mesh.vertices[indices], len(mesh.vertices))

    @cached_property
    def _identity(self) -> tuple[bytes, bytes]:
        return self.indices.tobytes(), self.positions.tobytes()

    def __eq__(self, other: object) -> bool:
        """Whether both hold the same vertices at the same positions."""
        return self is other or (isinstance(other, VertexSet) and self._identity == other._identity)

    def __hash__(self) -> int:
        """Equal sets hash alike."""
        return hash(self._identity)

    def __repr__(self) -> str:
        """Say how many there are."""
        return f"VertexSet({len(self.indices)} vertices)"

    def __str__(self) -> str:
        """Name it for a message."""
        count = len(self.indices)
        return f"a set of {count} {'vertex' if count == 1 else 'vertices'}"

    def inside(self, mesh: Mesh) -> Mask:
        """(V,) which vertices belong to it."""
        if self.lies_on(mesh):
            return _mask(mesh, self.indices)
        apart, nearest = cKDTree(mesh.vertices).query(self.positions)
        inside = _mask(mesh, nearest)
        reordered = self.count == len(mesh.vertices) and apart.max() <= SAME_POSITION * mesh.diagonal
        if not reordered and len(self.positions) > 1:
            tree = cKDTree(self.positions)
            spacing = float(np.median(tree.query(self.positions, k=2)[0][:, 1]))
            inside |= np.isfinite(tree.query(mesh.vertices, distance_upper_bound=NEAR_SPACING * spacing)[0])
        return inside

    def lies_on(self, mesh: Mesh) -> bool:
        """Whether the vertices of `mesh` with these indices lie where these lie."""
        if self.indices[-1] >= len(mesh.vertices):
            return False
        apart = np.linalg.norm(mesh.vertices[self.indices] - self.positions, axis=1)
        return bool(apart.max() <= SAME_POSITION * mesh.diagonal)


Region = Ball | Box | Group | HalfSpace | Part | VertexSet


def members(mesh: Mesh, region: Region) -> Indices:
    """(N,) ascending, the vertices of `mesh` in `region`; ValueError if there is none."""
    try:
        found = np.flatnonzero(region.inside(mesh))
    except ArgumentError as error:  # a name that the mesh does not have; who gave the region knows it as a whole
        raise ArgumentError("region", error.reason) from None
    if len(found) == 0:
        raise ArgumentError("region", f"must hold a vertex, but {region} holds none of the mesh's {len(mesh.vertices)}")
    return found


def distances_from(mesh: Mesh, region: Region) -> Float64:
    """(V,) how far each vertex lies outside of `region`, mesh units; of a set of vertices, from the nearest of them.

    Raises ValueError if it holds no vertex.
    """
    inside = members(mesh, region)
    match region:
        case Ball():
            away = np.linalg.norm(mesh.vertices - np.asarray(region.center), axis=1) - region.radius
        case Box():
            outside = np.maximum(np.asarray(region.low) - mesh.vertices, mesh.vertices - np.asarray(region.high))
            away = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
        case HalfSpace():
            away = region.offset - mesh.vertices @ np.asarray(region.normal)
        case _:
            away = cKDTree(mesh.vertices[inside]).query(mesh.vertices)[0]
    away[inside] = 0.0
    return np.asarray(np.maximum(away, 0.0), np.float64)


def _mask(mesh: Mesh, vertices: Any) -> Mask:
    """(V,) which of the mesh's vertices are `vertices` (N,)."""
    mask = np.zeros(len(mesh.vertices), bool)
    mask[vertices] = True
    return mask


def _point(position: Vector) -> str:
    return "(" + ", ".join(f"{x:g}" for x in position) + ")"
