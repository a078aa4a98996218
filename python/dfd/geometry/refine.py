"""Subdivide large triangles, so that distances along the surface are also computed inside them."""

import numpy as np

from dfd.common.linear_algebra import Float64, Int32, Int64, distinct_pairs
from dfd.geometry.topology import face_sides, face_sizes

_ROUNDS = 16  # largest number of rounds; each round halves all long edges


def split_long_edges(vertices: Float64, faces: Int32, longest: float, *, most: int) -> tuple[Float64, Int32]:
    """Return vertices and faces after halving edges until none is longer than `longest`, which must be above 0.

    The first vertices of the result are the given `vertices` (V, 3). Faces that share an edge share its midpoint. At
    most about `most` vertices are added, so some longer edges may remain.
    """
    sizes = face_sizes(vertices, faces)[0]
    long = sizes[sizes > longest]
    # A face whose longest side is k times `longest` gets about k + k² / 2 vertices.
    while (long / longest + (long / longest) ** 2 / 2).sum() > most:
        longest *= 1.5
        long = long[long > longest]
    for _ in range(_ROUNDS if len(long) else 0):
        ends = face_sides(faces)
        cut = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) > longest
        if not cut.any():
            break
        edges, number = distinct_pairs(ends[cut], len(vertices))
        middle = np.full((len(faces), 3), -1, np.int64)  # midpoints of the sides from corner 0 to 1, 1 to 2, 2 to 0
        middle[cut.reshape(-1, 3)] = len(vertices) + number
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        faces = _cut(vertices, faces.astype(np.int64), middle).astype(np.int32)
    return vertices, faces


def _cut(points: Float64, faces: Int64, middle: Int64) -> Int64:
    """Return `faces` (F, 3), divided at the midpoints of their sides: vertices `middle` (F, 3), or −1 for none."""
    count = (middle >= 0).sum(axis=1)
    result = [faces[count == 0]]
    # Rotate the corners so that a single divided side is the first, and a single undivided side is the last.
    for cuts, pattern in ((1, middle >= 0), (2, np.roll(middle < 0, 1, axis=1)), (3, middle >= 0)):
        chosen = count == cuts
        turn = (pattern[chosen].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[chosen], turn, axis=1).T
        ab, bc, ca = np.take_along_axis(middle[chosen], turn, axis=1).T
        if cuts == 1:
            pieces = [(a, ab, c), (ab, b, c)]
        elif cuts == 2:
            # The remaining quadrilateral a, ab, bc, c is divided along its shorter diagonal.
            first = np.linalg.norm(points[a] - points[bc], axis=1) < np.linalg.norm(points[ab] - points[c], axis=1)
            pieces = [(ab, b, bc), (a, ab, np.where(first, bc, c)), (np.where(first, a, ab), bc, c)]
        else:
            pieces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        result.extend(np.stack(piece, axis=1) for piece in pieces)
    return np.concatenate(result)
