"""Decide which faces at a vertex share a smooth normal, for all formats.

Blender and trimesh also divide smooth surfaces at edges of 30° if a file does not say how it is shaded.
"""

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float64, Int64, group_sums, unit
from dfd.mesh.normals import face_normals

# Smoothing groups of faces: the file says nothing, or the face is flat; the groups of smooth faces are above 0.
UNSAID, FLAT, SMOOTH = -1, 0, 1
_SHARP = np.cos(np.radians(30))  # smallest cosine between the normals of two faces that share smooth normals
_OPPOSITE = -0.99  # cosine below which two faces at an edge are the sides of a sheet
_MOST_SIDES = 8  # more faces at one edge share no smooth normals across it


def corner_normals(vertices: Float64, faces: NDArray[np.integer], smoothing: Int64) -> tuple[Int64, Float64]:
    """Return the index (F, 3) of each face corner's normal, and the unit normals (G, 3); a normal without faces is 0.

    A normal is the area-weighted mean of the faces around a vertex that are connected across smooth edges. An edge is
    smooth if its faces have the same order of corners and the same `smoothing` group (F,) above 0; or if the file does
    not say the group of one of them, and their normals differ by at most 30°. A face without area divides nothing.
    """
    scaled = vertices / (float(np.ptp(vertices, axis=0).max()) or 1.0)
    normals = face_normals(scaled, faces)
    first, second, joined = _sides(faces, unit(normals), smoothing)
    corner = faces.ravel().astype(np.int64)
    divided = np.zeros(len(vertices), bool)  # vertices at which not all faces share a normal
    divided[corner[np.concatenate([first[~joined], second[~joined]])]] = True
    divided[corner[_next(np.concatenate([first[~joined], second[~joined]]))]] = True
    divided[faces[smoothing == FLAT]] = True
    group = corner.copy()
    here = np.flatnonzero(divided[corner])
    if len(here):
        group[here] = len(vertices) + _components(here, first[joined], second[joined], corner)
    return group.reshape(-1, 3), unit(group_sums(group, np.repeat(normals, 3, axis=0), int(group.max()) + 1))


def _sides(faces: NDArray[np.integer], up: Float64, smoothing: Int64) -> tuple[Int64, Int64, Bool]:
    """Return pairs of face sides at the same edge, two arrays (E,), and whether smooth normals join the pair (E,).

    Side 3 · f + c of face f begins at its corner c. `up` (F, 3) are unit normals. Pairs that are not joined are
    reported only if the sides are neighbors in the list of sides of their edge.
    """
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
    forward = ends[:, 0] < ends[:, 1]
    key = ends.min(axis=1) * (int(faces.max()) + 1) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    found: list[tuple[Int64, Int64, Bool]] = []
    for step in range(1, _MOST_SIDES):
        same = np.flatnonzero(key[order[:-step]] == key[order[step:]])
        if not len(same):
            break
        first, second = order[same], order[same + step]
        cosine = np.einsum("ei,ei->e", up[first // 3], up[second // 3])
        groups = smoothing[first // 3], smoothing[second // 3]
        least = np.where((groups[0] == UNSAID) | (groups[1] == UNSAID), _SHARP, _OPPOSITE)
        flat = (groups[0] == FLAT) | (groups[1] == FLAT) | ((groups[0] != groups[1]) & (least == _OPPOSITE))
        empty = ~(up[first // 3].any(axis=1) & up[second // 3].any(axis=1))
        joined = ~flat & (empty | ((forward[first] != forward[second]) & (cosine >= least)))
        told = joined | (step == 1)
        found.append((first[told], second[told], joined[told]))
    first, second, joined = (np.concatenate(each) for each in zip(*found, strict=True)) if found else _NOTHING
    return first, second, joined


_NOTHING = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, bool))


def _next(side: Int64) -> Int64:
    """Return the corner (E,) at which each side ends."""
    return side - side % 3 + (side + 1) % 3


def _components(here: Int64, first: Int64, second: Int64, corner: Int64) -> Int64:
    """Return the component (N,) of each of the corners `here` (N,): joined sides connect their corners at a vertex.

    `corner` (3 · F,) is the vertex of each corner.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    number = np.full(len(corner), -1, np.int64)
    number[here] = np.arange(len(here))
    begins, ends = (first, _next(first)), (second, _next(second))
    links = [
        np.stack([number[a], number[b]], axis=1)[(corner[a] == corner[b]) & (number[a] >= 0)]
        for a in begins
        for b in ends
    ]
    rows, columns = np.concatenate(links).T
    graph = coo_matrix((np.ones(len(rows), bool), (rows, columns)), shape=(len(here), len(here)))
    return connected_components(graph, directed=False)[1].astype(np.int64)
