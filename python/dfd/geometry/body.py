"""Find the surface of a body in a mesh that may be inside out, partly flipped, cut, doubled, or with fins.

Segmentation looks at this surface, so that damage of a file changes no part. Undamaged meshes are their own body.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

import dfd._core as _core
from dfd.common.linear_algebra import Bool, Float64, Int32, Int64, distinct_pairs
from dfd.geometry.surface_graph import GAPS
from dfd.geometry.topology import are_distinct, dirty_vertices, face_areas, face_sides, first_at_place
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import smooth_normals

# The sign of the volume decides which side of a piece is outside, if the volume is at least FLAT times area ** 1.5. A
# ball has 0.094, and a square sheet 0.3 % as thick as it is wide has 0.001. Otherwise, most of the area keeps its side.
FLAT = 1e-3
FIN = 1e-3  # a piece that hangs on an edge of two other faces is no part of the body below this share of the area
LEAST_PULL = 1e-9  # of a piece to its own place, compared with that of one link
COVERED = 0.95  # two pieces are two walls of one body if at least this share of the nodes of each is near the other


class Body(NamedTuple):
    """The surface of a body."""

    vertices: Float64  # (V, 3) positions, in mesh units, of the vertices of the mesh if its cuts were closed
    faces: Int32  # (F, 3) faces of the mesh with consistent sides, without copies, fins and second walls
    left_out: Bool  # (F,) the faces of the mesh that are fins or second walls
    stands_for: Int32  # (V,) the vertex of the body for which each vertex stands; equal at both sides of a cut


def body_of(mesh: Mesh, links: Int32) -> Body:
    """Return the body of a mesh. `links` (L, 2) are its `seam_links`.

    Vertices at equal places, and on both sides of a seam, are one vertex. The faces of each piece agree
    about their sides, and look outwards. Small pieces that hang on an edge of other faces, and the inner wall of a
    hollow piece, are left out: their vertices stand for the nearest vertices of the body.
    """
    count, vertices, stands_for = len(mesh.vertices), mesh.vertices, first_at_place(mesh)
    cut = (vertices[links[:, 0]] != vertices[links[:, 1]]).any(axis=1)
    if cut.any():
        vertices = _closed(vertices, _core.components(count, mesh.faces, links[~cut]), links[cut])
        group = _core.components(count, np.zeros((0, 3), np.int32), links)
        stands_for = np.unique(group, return_index=True)[1].astype(np.int32)[group]
    faces, chosen = stands_for[mesh.faces], mesh.faces
    distinct = are_distinct(faces)
    if not distinct.all():
        faces, chosen = faces[distinct], chosen[distinct]
    piece, flipped = _pieces(faces, count)
    flipped ^= _looks_inwards(mesh.vertices, faces, piece, flipped)[piece]
    if flipped.any():
        chosen = np.where(flipped[:, None], chosen[:, ::-1], chosen)
    left_out = np.zeros(len(mesh.faces), bool)
    if piece.max(initial=0) == 0:
        return Body(vertices, chosen, left_out, stands_for)
    areas = face_areas(mesh.vertices, faces)
    loose = _fins(faces, piece, areas)
    loose |= _inner_walls(mesh, np.where(flipped[:, None], faces[:, ::-1], faces), piece, areas)
    if loose.any():
        inside = np.zeros(count, bool)
        inside[faces[~loose]] = True
        own, outside = np.flatnonzero(inside), np.unique(faces[loose])
        outside = outside[~inside[outside]]
        nearest = np.arange(count, dtype=np.int32)
        nearest[outside] = own[cKDTree(mesh.vertices[own]).query(mesh.vertices[outside])[1]]
        stands_for, chosen = nearest[stands_for], chosen[~loose]
        left_out[np.flatnonzero(distinct)[loose]] = True
    return Body(vertices, chosen, left_out, stands_for)


def _closed(vertices: Float64, piece: Int32, links: Int32) -> Float64:
    """Return `vertices` (V, 3) after each `piece` (V,) is moved so that `links` (L, 2) between pieces are shortest."""
    ends = piece[links]
    some = ends[:, 0] != ends[:, 1]
    used, number = np.unique(ends[some], return_inverse=True)
    number = number.reshape(-1, 2)
    if not len(used):
        return vertices
    rows = np.arange(len(number))
    signs = coo_array(
        (np.tile([1.0, -1.0], len(rows)), (np.repeat(rows, 2), number.ravel())), shape=(len(rows), len(used))
    )
    gaps = vertices[links[some, 1]] - vertices[links[some, 0]]
    # The sum of all moves is 0 up to the small second term, without which any common move could be added.
    normal = (signs.T @ signs + LEAST_PULL * eye_array(len(used))).tocsc()
    moves = np.zeros((len(vertices), 3))
    moves[used] = splu(normal).solve(signs.T @ gaps)
    return vertices + moves[piece]


def _pieces(faces: Int32, count: int) -> tuple[Int64, Bool]:
    """Return the piece (F,) of each of `faces` (F, 3), and whether the face has another side than others of its piece.

    A piece is joined by edges of two faces. `count` is the number of vertices.
    """
    dirty = dirty_vertices(faces, count)
    sides = face_sides(faces) if dirty.any() else np.zeros((0, 2), np.int32)
    some = np.flatnonzero(dirty[sides].all(axis=1) & (sides[:, 0] != sides[:, 1]))
    pairs, which = distinct_pairs(sides[some], count)
    uses = np.bincount(which, minlength=len(pairs))
    forward = np.bincount(which, sides[some][:, 0] < sides[some][:, 1], len(pairs))
    if (uses <= 2).all() and (forward[uses == 2] == 1).all():  # all sides agree already
        piece = _core.components(count, np.ascontiguousarray(faces), np.zeros((0, 2), np.int32))[faces[:, 0]]
        return np.unique(piece, return_inverse=True)[1], np.zeros(len(faces), bool)
    # Each face is two nodes of a graph, one for each side. An edge joins the sides of two faces that agree. Around a
    # vertex that is not dirty, all faces agree.
    number = len(faces)
    order = np.argsort(which, kind="stable")
    first = order[np.cumsum(uses) - uses][uses == 2]
    second = order[np.minimum(np.cumsum(uses) - uses + 1, len(order) - 1)][uses == 2]
    one, other = some[first] // 3, some[second] // 3
    turned = number * (forward[uses == 2] != 1)
    clean = np.flatnonzero(~dirty[faces].ravel())
    corner, vertex = clean // 3, 2 * number + faces.ravel()[clean].astype(np.int64)
    links = [
        np.stack([one, other + turned], axis=1),
        np.stack([one + number, other + number - turned], axis=1),
        np.stack([corner, vertex], axis=1),
        np.stack([corner + number, vertex + count], axis=1),
    ]
    joined = np.concatenate(links).astype(np.int32)
    label = _core.components(2 * (number + count), np.zeros((0, 3), np.int32), joined)
    here, there = label[:number], label[number : 2 * number]
    return np.unique(np.minimum(here, there), return_inverse=True)[1], np.asarray(here > there)


def _looks_inwards(vertices: Float64, faces: Int32, piece: Int64, flipped: Bool) -> Bool:
    """Return whether each piece (P,) looks inwards after its `flipped` faces are reversed."""
    sizes = np.empty((int(piece.max(initial=-1)) + 1, 3))
    arrays = np.ascontiguousarray(vertices), np.ascontiguousarray(faces)
    _core.piece_sizes(*arrays, piece.astype(np.int32)[:, None], flipped.astype(np.int32)[:, None], sizes)
    area, majority, volume = sizes.T
    return np.where(np.abs(volume) > FLAT * area**1.5, volume, majority) < 0


def _fins(faces: Int32, piece: Int64, areas: Float64) -> Bool:
    """Return whether each face (F,) belongs to a small piece that hangs on an edge of two other faces."""
    area = np.bincount(piece, areas)
    small = (area < FIN * area.sum())[piece]
    if not small.any():
        return small
    sides = face_sides(faces)
    pairs, which = distinct_pairs(sides, int(faces.max()) + 1)
    uses = np.bincount(which, minlength=len(pairs))
    hangs = (uses[which] > 2).reshape(-1, 3).any(axis=1) & small
    return np.isin(piece, piece[hangs]) & small


def _inner_walls(mesh: Mesh, faces: Int32, piece: Int64, areas: Float64) -> Bool:
    """Return whether each face (F,) belongs to the inner wall of a hollow piece. `faces` (F, 3) look outwards.

    Two pieces are the walls of one if each covers the other: `COVERED` of its vertices have a vertex of the other with
    a similar normal within the smaller of `GAPS`. The inner wall is the one with the smaller area.
    """
    near, area = GAPS[0] * mesh.diagonal, np.bincount(piece, areas)
    of_vertex = np.full(len(mesh.vertices), -1)
    of_vertex[faces] = piece[:, None]
    large = np.flatnonzero(area >= FIN * area.sum())
    order = large[np.argsort(-area[large], kind="stable")]
    order = order[np.isin(order, of_vertex)]
    if len(order) < 2:
        return np.zeros(len(faces), bool)
    by_piece = np.argsort(of_vertex, kind="stable")
    bounds = np.searchsorted(of_vertex[by_piece], np.stack([order, order + 1], axis=1))
    vertices = [by_piece[start:end] for start, end in bounds]
    places = [mesh.vertices[some] for some in vertices]
    boxes = [np.concatenate([each.min(axis=0), each.max(axis=0)]) for each in places]
    # Covered pieces have nearly the same bounding box.
    pairs = cKDTree(boxes).query_pairs(near, p=np.inf, output_type="ndarray")
    if not len(pairs):
        return np.zeros(len(faces), bool)
    trees = {number: cKDTree(places[number]) for number in np.unique(pairs).tolist()}
    normals = smooth_normals(mesh.vertices, faces)

    def covered(one: int, other: int) -> bool:
        """Return whether the piece `other` covers the piece `one`."""
        apart, nearest = trees[other].query(places[one], distance_upper_bound=near)
        close = np.isfinite(apart)
        agree = (normals[vertices[one][close]] * normals[vertices[other][nearest[close]]]).sum(axis=1) > 0
        return bool(np.count_nonzero(agree) >= COVERED * len(apart))

    inner = [order[max(pair)] for pair in pairs.tolist() if covered(*pair) and covered(*pair[::-1])]
    return np.isin(piece, inner)
