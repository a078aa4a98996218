"""Places of handles and fixed points, and the texts that name them."""

from __future__ import annotations

import math
import re
from collections.abc import Hashable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from dfd.common import check
from dfd.common.described import Brief, Tagged, Written
from dfd.common.errors import ArgumentError, within
from dfd.editing.regions import Ball, Box, Group, HalfSpace, Part, Region, VertexSet, members
from dfd.posing.transforms import Vector, vector

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

# The direction of each word: the index of an axis, and a sign. "left" is on the left of a viewer in front of the shape.
EXTREMES = {"top": (1, 1), "bottom": (1, -1), "right": (0, 1), "left": (0, -1), "front": (2, 1), "back": (2, -1)}
SIDE = re.compile(r"([xyz])\s*([<>])\s*(.+)")

NOWHERE: Vector = (math.nan, math.nan, math.nan)  # position of a place whose position is unknown


@dataclass(frozen=True, repr=False)
class Place(Brief):
    """The place of a handle or a fixed point on the resting shape: a vertex, a region, or a point in space.

    Raises ValueError if the place has no vertex, position or region, or a number is out of its bounds.
    """

    # position: (3,) in mesh units; for a region, the center of its bounding box. If an edit file gives no position, the
    # value is `NOWHERE` until `place_on` computes the position on a mesh.
    position: Annotated[Vector, Written(Vector | None)] = NOWHERE
    vertex: int | None = None  # index of the vertex at the position, or None
    # region: the set of vertices, or None for a single point
    region: Annotated[Region, Tagged("kind")] | None = None

    def __post_init__(self) -> None:
        if self.position is None:
            object.__setattr__(self, "position", NOWHERE)
        if self.vertex is not None:
            check.whole("Place", "vertex", self.vertex, minimum=0)
        if not self.known and self.vertex is None and self.region is None:
            raise ArgumentError("place", "must have a vertex, a position or a region", "Place")
        check.bounded("Place", "position", self.position)

    @cached_property
    def known(self) -> bool:
        """Return whether the position is known."""
        return not math.isnan(self.position[0])

    @cached_property
    def key(self) -> Hashable:
        """Return a key for comparisons. A vertex and a point at the same position have equal keys."""
        return (self.position, self.region) if self.known else self

    def __str__(self) -> str:
        """Return the name of the place for messages. A point is written as "x,y,z", as on the command line."""
        if self.region is not None:
            return str(self.region)
        return ",".join(f"{x:g}" for x in self.position) if self.vertex is None else str(self.vertex)


class Found(NamedTuple):
    """The place that a text names on a mesh."""

    place: Place
    note: str  # one line for users, such as "top is vertex 812" or "x>0 is 140 vertices"


def place_on(mesh: Mesh, at: Any) -> Place:
    """Return the place that `at` names on a mesh.

    `at` is a vertex index, a point (3,) in mesh units on or off the surface, an array of vertex indices, a mask (V,)
    of bool, a region, a text (see `find`), or a `Place`. Negative indices count from the end. The vertex or region of a
    `Place` gives a position on `mesh`.

    Raises ValueError if `at` is none of these, or a region contains no vertex. Raises ValueError if the distance of a
    point from the nearest vertex exceeds the diagonal of the bounding box.
    """
    if isinstance(at, Place):
        said = at.vertex if at.region is None else at.region
        if said is None:
            nearest_vertex(mesh, at.position)
            return at
        return place_on(mesh, said)
    if isinstance(at, str):
        return find(mesh, at).place
    if isinstance(at, Region):
        return _region_place(mesh, at)[0]
    if isinstance(at, np.ndarray) and at.ndim == 1 and at.dtype.kind in "iub":
        return _region_place(mesh, VertexSet.of(mesh, at))[0]
    if isinstance(at, list | tuple | set | range) and len(at) != 3 and all(isinstance(each, int) for each in at):
        what = f"got {len(at)} whole numbers: pass vertex indices as a NumPy array, `np.array([…])`"
        raise ArgumentError("at", f"must be a vertex index, a point, a region or a text, {what}")
    if np.ndim(at) == 0:
        if isinstance(at, bool) or not isinstance(at, int | np.integer):
            raise ArgumentError("at", f"must be a vertex index, a point, a region or a text, got {at!r}")
        vertex = int(check.vertex_indices("place", "at", [at], len(mesh.vertices))[0])
        return Place(vector("at", mesh.vertices[vertex]), vertex)
    point = vector("at", at)
    try:
        nearest_vertex(mesh, point)
    except ArgumentError as error:
        if not all(isinstance(each, int | np.integer) for each in at):
            raise
        raise ArgumentError("at", f"{error.reason}; pass vertex indices as a NumPy array, `np.array([…])`") from None
    return Place(point)


def find(mesh: Mesh, text: str) -> Found:
    """Return the place that `text` names on `mesh`, with a line that describes the place.

    `812` is a vertex. `0.1,0.2,0.3` is the vertex nearest to this point. `top`, `bottom`, `left`, `right`, `front` and
    `back` are the vertices farthest in these directions (up is +y, front is +z, right is +x). `part:NAME` is a part of
    the mesh's scene. `group:NAME` contains the faces after the line `g NAME`, `o NAME` or `usemtl NAME` of an OBJ file.
    `material:NAME` is all surface of one material. `x>0.5` and `y<0` are sides of a plane. `ball:x,y,z,radius` is a
    ball. `box:x,y,z,x,y,z` is a box with these two corners. `component@812` is the connected component at vertex 812.

    Raises ValueError if `text` names no place of the mesh; the message gives the expected forms.
    """
    said = text.strip()
    try:
        region = _region_in(mesh, said)
        if region is not None:
            with within("at"):
                place, count = _region_place(mesh, region)
            return Found(place, f"{said} is {count} {'vertex' if count == 1 else 'vertices'}")
        if said in EXTREMES:
            axis, sign = EXTREMES[said]
            vertex = int((sign * mesh.vertices[:, axis]).argmax())
            note = f"{said} is vertex {vertex}"
        elif "," in said:
            vertex, distance = nearest_vertex(mesh, vector("at", [float(number) for number in said.split(",")]))
            note = f"{said} is vertex {vertex}, {distance:.3g} away"
        else:
            vertex = int(check.vertex_indices("place", "at", [int(said)], len(mesh.vertices), wrap=False)[0])
            note = f"vertex {vertex}"
    except ArgumentError:
        raise
    except ValueError:
        close = get_close_matches(said, EXTREMES, 1)
        raise ArgumentError(
            "at",
            f"must be a vertex index, a point x,y,z, {', '.join(EXTREMES)}, part:NAME, group:NAME, material:NAME, "
            f"component@PLACE, x>NUMBER, ball:x,y,z,radius or box:x,y,z,x,y,z, got {text!r}"
            f"{f'; did you mean {close[0]}?' if close else ''}",
        ) from None
    return Found(place_on(mesh, vertex), note)


def _region_in(mesh: Mesh, said: str) -> Region | None:
    """Return the region that `said` names, or None for other texts. Raises ValueError if a number cannot be read."""
    if said.startswith("component@"):
        where = said.removeprefix("component@")
        if where.lstrip().startswith("component@"):
            raise ValueError  # without this limit, a long text would need too many nested calls
        at = find(mesh, where).place
        vertex = nearest_vertex(mesh, at.position)[0] if at.vertex is None else at.vertex
        from dfd.geometry.coarse import nodes_of  # imported here, because it is slow and `dfd --help` does not need it

        nodes = nodes_of(mesh)
        component = nodes.component[nodes.of_vertex]
        return VertexSet.of(mesh, component == component[vertex])
    if side := SIDE.fullmatch(said):
        towards = 1.0 if side[2] == ">" else -1.0
        x, y, z = (towards if axis == side[1] else 0.0 for axis in "xyz")
        return HalfSpace((x, y, z), towards * float(side[3]))
    match said.partition(":"):
        case _, _, "":
            return None
        case "part", _, name:
            return Part(name)
        case "group", _, name:
            return Group(name)
        case "material", _, name:  # `Part` also finds materials of a scene
            return Group(name) if name in mesh.group_names else Part(name)
        case "ball", _, numbers:
            x, y, z, radius = (float(number) for number in numbers.split(","))
            return Ball((x, y, z), radius)
        case "box", _, numbers:
            corners: Any = np.array(numbers.split(","), float).reshape(2, 3)
            return Box(*corners)
    return None


def nearest_vertex(mesh: Mesh, point: Vector) -> tuple[int, float]:
    """Return the vertex nearest to `point`, and its distance in mesh units.

    Raises ValueError if the distance exceeds the diagonal of the bounding box.
    """
    squares = np.square(mesh.vertices - np.asarray(point)).sum(axis=1)
    vertex = int(squares.argmin())
    distance = float(np.sqrt(squares[vertex]))
    if distance > mesh.diagonal:
        place = ",".join(f"{x:g}" for x in point)
        raise ArgumentError(
            "at",
            f"must lie near the shape, but {place} is {distance:.4g} away, "
            f"more than the diagonal of its box, {mesh.diagonal:.4g}",
        )
    return vertex, distance


def _region_place(mesh: Mesh, region: Region) -> tuple[Place, int]:
    """Return the place of a region, and the number of its vertices."""
    held = mesh.vertices[members(mesh, region)]
    return Place(vector("at", (held.min(axis=0) + held.max(axis=0)) / 2), region=region), len(held)
