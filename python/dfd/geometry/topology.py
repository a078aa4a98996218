"""Count the components and defects of a mesh, measure its faces, and sample its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

import dfd._core as _core
from dfd.common.linear_algebra import Bool, Float32, Float64, Int32, Int64, distinct_pairs
from dfd.common.threads import get_num_threads
from dfd.mesh.weld import weld

if TYPE_CHECKING:  # `dfd.mesh.mesh` imports all mesh readers, which takes time
    from dfd.mesh.mesh import Mesh

_CELLS = (1 << 21) // 3  # number of cells of a Z-order curve along each axis: the sum of three cells has 21 bits
# Shifts of `_spread`, and the bits that remain after each.
_SPREADING = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


@dataclass(frozen=True)
class Topology:
    """Counts of a mesh. For edges and faces, vertices at the same position are one vertex."""

    vertex_count: int
    face_count: int
    components: int  # connected components of the surface
    boundary_edges: int  # edges that belong to one face
    non_manifold_edges: int  # edges that belong to more than two faces
    opposed_edges: int  # edges of two faces that look to different sides of the surface
    degenerate_faces: int  # faces without area
    duplicate_faces: int  # faces with the same three corners as an earlier face, in any order
    unreferenced_vertices: int  # vertices that belong to no face
    extents: tuple[float, float, float]  # sides of the bounding box, in mesh units
    parts: int  # number of parts of the file's scene, see `Mesh.parts`
    materials: int
    textures: int


def inspect(mesh: Mesh) -> Topology:
    """Return the counts of components and defects of a mesh.

    For edges and components, only faces with three different corners count.
    """
    faces = first_at_place(mesh)[mesh.faces]
    proper = faces[_three_corners(faces)]
    sides = face_sides(proper)
    edge = distinct_pairs(sides, len(mesh.vertices))[1]
    uses = np.bincount(edge)  # number of faces of each edge
    turns = np.bincount(edge, np.where(sides[:, 0] < sides[:, 1], 1, -1), len(uses))
    look = mesh.appearance
    textures = {id(each.texture) for each in look.materials if each.texture is not None} if look else set()
    return Topology(
        vertex_count=len(mesh.vertices),
        face_count=len(mesh.faces),
        components=int(face_components(proper).max(initial=-1)) + 1,
        boundary_edges=int((uses == 1).sum()),
        non_manifold_edges=int((uses > 2).sum()),
        opposed_edges=int(((uses == 2) & (turns != 0)).sum()),
        degenerate_faces=int((~_has_area(mesh.vertices, faces)).sum()),
        duplicate_faces=int((~are_distinct(faces)).sum()),
        unreferenced_vertices=int((np.bincount(mesh.faces.ravel(), minlength=len(mesh.vertices)) == 0).sum()),
        extents=(float(mesh.extents[0]), float(mesh.extents[1]), float(mesh.extents[2])),
        parts=len(mesh.parts),
        materials=len(look.materials) if look else 0,
        textures=len(textures),
    )


_FIRST: WeakKeyDictionary[Mesh, Int32] = WeakKeyDictionary()


def first_at_place(mesh: Mesh) -> Int32:
    """Return, for each vertex, the first vertex with the same position, as a read-only array (V,)."""
    if mesh not in _FIRST:
        first, vertex = weld(mesh.vertices)
        _FIRST[mesh] = first.astype(np.int32)[vertex]
        _FIRST[mesh].flags.writeable = False
    return _FIRST[mesh]


def dirty_vertices(faces: Int32, count: int) -> Bool:
    """Return which of `count` vertices lie on a border of the surface, or on an edge of faces with different sides.

    Around all other vertices, the sides of the faces opposite to the vertex form closed loops. So in each loop, the
    differences between codes of the vertices have the sum 0. The codes are random, so other sums of 0 are unlikely.
    """
    code = np.random.default_rng(0).integers(1 << 40, size=count).astype(np.float64)
    turn = np.zeros(count)
    for one, other, last in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        turn += np.bincount(faces[:, one], code[faces[:, other]] - code[faces[:, last]], count)
    return turn != 0


def are_distinct(faces: NDArray[np.integer]) -> Bool:
    """Return whether each of `faces` (F, 3) is the first with its corners, in any order, (F,)."""
    one, other, last = faces.T.astype(np.uint64, copy=False)
    low, high = np.minimum(np.minimum(one, other), last), np.maximum(np.maximum(one, other), last)
    prime = np.uint64(0x9E3779B97F4A7C15)  # the odd number nearest to 2⁶⁴ divided by the golden ratio
    key = (low * prime + high) * prime + (one + other + last)
    first = np.ones(len(key), bool)
    if len(key) > 1 and not np.diff(np.sort(key)).all():
        first[:] = False
        first[np.unique(key, return_index=True)[1]] = True
    return first


def face_components(faces: Int32) -> Int32:
    """Return the index (F,) of the connected component of each of `faces` (F, 3), counted from 0."""
    if len(faces) == 0:
        return np.zeros(0, np.int32)
    numbers = _core.components(int(faces.max()) + 1, np.ascontiguousarray(faces, np.int32), np.zeros((0, 2), np.int32))
    return np.unique(numbers[faces[:, 0]], return_inverse=True)[1].astype(np.int32)


def face_sides(faces: Int32) -> Int32:
    """Return the ends (3 F, 2) of the sides of `faces` (F, 3): corners 0 to 1, 1 to 2, and 2 to 0 of each face."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def face_sizes(vertices: NDArray[np.floating], faces: Int32) -> tuple[Float64, Float64]:
    """Return the longest side (F,) of each face, in units of `vertices` (V, 3), and the area (F,) in squared units."""
    sizes = np.empty((len(faces), 2))
    points, corners = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int32)
    _core.face_sizes(points, corners, sizes, get_num_threads())
    return sizes[:, 0], sizes[:, 1]


def face_areas(vertices: NDArray[np.floating], faces: Int32) -> Float64:
    """Return the area (F,) of each face, in squared units of `vertices` (V, 3)."""
    return face_sizes(vertices, faces)[1]


def vertex_areas(vertices: NDArray[np.floating], faces: Int32) -> Float64:
    """Return a third of the total area of each vertex's faces, (V,), in squared units of `vertices` (V, 3)."""
    thirds = np.repeat(face_areas(vertices, faces) / 3, 3)
    return np.bincount(faces.ravel(), thirds, len(vertices)).astype(np.float64)


def _three_corners(faces: Int32) -> Bool:
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)


def _has_area(vertices: Float64, faces: Int32) -> Bool:
    """Return whether the area of each face exceeds its rounding error, (F,) bool."""
    size = np.abs(vertices).max(initial=0.0)
    corners = vertices[faces] / (size if size > 0 else 1.0)  # prevents overflow and underflow of products
    along, aside = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    crossed = np.cross(along, aside)
    # Rounding of coordinates of size s changes the area of a thin face of length l by up to about s · l · epsilon.
    size = np.abs(corners).max(axis=(1, 2))
    length = np.maximum(np.abs(along).max(axis=1), np.abs(aside).max(axis=1))
    large: Bool = np.abs(crossed).max(axis=1) > 4 * np.finfo(np.float64).eps * size * length
    return _three_corners(faces) & large


def by_position(vertices: NDArray[np.floating], faces: Int32) -> Int64:
    """Return the indices (N,) of the distinct `faces` (F, 3), in an order that positions decide.

    The faces follow a Z-order curve (Morton 1966) through their centers. So samples of a surface depend neither on the
    order of vertices and faces in a file, nor on repeated faces.
    """
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    cells = _cells(vertices, vertices if used.all() else vertices[used])
    first, second, third = np.ascontiguousarray(faces.T)
    code = np.zeros(len(faces), np.int64)
    for axis, cell in enumerate(cells):
        code |= _spread(cell[first] + cell[second] + cell[third]) << axis
    order = np.argsort(code)
    equal = np.diff(code[order]) == 0
    tied = np.flatnonzero(np.append(equal, False) | np.append(False, equal))
    if len(tied) == 0:
        return order
    some = order[tied]
    corners = sorted_corners(vertices, faces[some])
    ranks = np.lexsort((some, *_key(cells[:, corners]).T[::-1], code[some]))  # of equal faces, the first one is kept
    order[tied], places = some[ranks], vertices[corners[ranks]]
    return np.delete(order, tied[1:][(places[:-1] == places[1:]).all(axis=(1, 2))])


def sorted_corners(vertices: NDArray[np.floating], faces: Int32) -> Int32:
    """Return `faces` (F, 3), each with its corners in the order of x, then y, then z. So they have no side."""
    corners = vertices[faces.ravel()]
    order = np.argsort(_key(_cells(corners, corners)).reshape(faces.shape), axis=1, kind="stable")
    return np.take_along_axis(faces, order, axis=1)


def _cells(points: NDArray[np.floating], box_of: NDArray[np.floating]) -> Int64:
    """Return the cell (3, N) of each of `points` (N, 3) in a cubic grid around the points `box_of` (M, 3)."""
    low, high = box_of.min(axis=0).astype(np.float64), box_of.max(axis=0)
    size = float((high - low).max()) or 1.0
    return np.rint((points - low).clip(0, size).T * (_CELLS / size)).astype(np.int64)


def _key(cells: Int64) -> Int64:
    """Return a number (...) for each of `cells` (3, ...), in the order of x, then y, then z."""
    return np.asarray(cells[0] << 42 | cells[1] << 21 | cells[2])


def _spread(values: Int64) -> Int64:
    """Return whole numbers (N,) of 21 bits with two zeros between each bit and the next."""
    for shift, mask in _SPREADING:
        values = (values | (values << shift)) & mask
    return values


def scene_parts_and_materials(mesh: Mesh) -> Int64:
    """Return the index of the scene part (`Mesh.parts`) and of the material of each face, (2, F)."""
    labels = np.zeros((2, len(mesh.faces)), np.int64)
    for number, part in enumerate(mesh.parts):
        labels[0, part.faces] = number
    if mesh.appearance is not None:
        labels[1] = mesh.appearance.face_material
    return labels


def even_points(vertices: NDArray[np.floating], faces: Int32, count: int) -> tuple[Int32, Float32]:
    """Spread points evenly on `faces` (F, 3). Return the corners (count, 3) of their faces, and barycentric rows."""
    order = by_position(vertices, faces)
    areas = face_areas(vertices, faces)[order]
    evenly = (np.arange(count) + 0.5) / count * areas.sum()
    hit = np.minimum(np.searchsorted(np.cumsum(areas), evenly), len(areas) - 1)
    face, barycentric = points_on_faces(np.bincount(hit, minlength=len(areas)))
    corners = sorted_corners(vertices, faces[order[face]])
    # Few points of a face have no even spread about its center, so the first corners of neighboring faces differ.
    return np.take_along_axis(corners, (face[:, None] + np.arange(3)) % 3, axis=1), barycentric


def sample_surface(
    vertices: NDArray[np.floating], faces: Int32, count: int, generator: np.random.Generator
) -> tuple[Float64, Int64]:
    """Return random surface samples (count, 3), uniform by area, and the face (count,) of each sample.

    Samples are stratified: the faces, in the order of `by_position`, are divided into `count` intervals of equal area
    with one sample each.
    """
    order = by_position(vertices, faces)
    total = np.cumsum(face_areas(vertices, faces)[order])
    at = (np.arange(count) + generator.random(count)) / count * total[-1]
    face = order[np.searchsorted(total, at, side="right").clip(0, len(order) - 1)]
    u, v = generator.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    first, second, third = vertices[sorted_corners(vertices, faces[face])].astype(np.float64).transpose(1, 0, 2)
    return first + u[:, None] * (second - first) + v[:, None] * (third - first), face


def points_on_faces(counts: Int64) -> tuple[Int64, Float32]:
    """Place `counts[f]` points on face f. Return the face (N,) of each point, ascending, and barycentric rows (N, 3).

    The points cover a face evenly. The first point is the center. The method is the additive sequence of Roberts, "The
    unreasonable effectiveness of quasirandom sequences", 2018.
    """
    ends = np.cumsum(counts)
    face = np.repeat(np.arange(len(counts)), counts)
    index = np.arange(len(face)) - (ends - counts)[face]
    step = np.array([0.7548776662466927, 0.5698402909980532])  # 1/g and 1/g², g³ = g + 1
    across = (1 / 3 + index[:, None] * step) % 1
    across = np.where(across.sum(axis=1, keepdims=True) > 1, 1 - across, across)
    return face, np.column_stack([1 - across.sum(axis=1), across]).astype(np.float32)
