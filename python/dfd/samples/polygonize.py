"""Convert a shape to a closed mesh, exactly symmetric in the plane x = 0, by surface nets on a grid.

Surface nets (S. F. F. Gibson, "Constrained elastic surface nets", MICCAI 1998) have a vertex in each grid cell that the
surface crosses, and a quadrilateral around each grid edge that the surface crosses. If separate pieces (sheets) of the
surface pass through a cell, each sheet has its own vertex. So the mesh is a manifold (G. M. Nielson, "Dual marching
cubes", IEEE Visualization 2004).
"""

from functools import cache

import numpy as np

import dfd._core as _core
from dfd.common.linear_algebra import Bool, Float64, Int32, Int64, UInt8, group_sums
from dfd.samples.implicit import Shape

_FIRST_SPACING = 1 / 40  # spacing of a trial grid, whose number of faces determines the final spacing
_MOST_GRID_FACES = 60_000  # a mesh of more faces is made by subdivision of a coarser mesh
_CORNERS = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
_EDGES = [  # the 12 edges of a cell: (axis, start corner, end corner), indices of `_CORNERS`
    (axis, corner, corner + (4, 2, 1)[axis]) for axis in range(3) for corner in range(8) if not _CORNERS[corner][axis]
]


def polygonize(
    shape: Shape, low: tuple[float, float, float], high: tuple[float, float, float], faces: int
) -> tuple[Float64, Int32]:
    """Return vertices (V, 3) and triangles (F, 3), with outward normals, of a mesh of about `faces` faces.

    The shape must lie inside the box with the opposite corners `low` and `high`. Each vertex (x, y, z) has an exact
    mirror image (−x, y, z), and each face has a mirror image.
    """
    halvings = 0
    while faces / 4**halvings > _MOST_GRID_FACES:
        halvings += 1
    wanted = faces / 4**halvings
    count = 2 * len(_half(shape, low, high, _FIRST_SPACING)[1])
    spacing = _FIRST_SPACING * np.sqrt(count / wanted)  # the number of faces grows with the square of the resolution
    vertices, triangles = _connected(*_half(shape, low, high, spacing))
    vertices = _smoothed(shape, vertices, triangles, spacing)
    for _ in range(halvings):
        import trimesh  # slow to import, and needed only for fine meshes

        vertices, triangles = trimesh.remesh.subdivide(vertices, triangles)
        spacing /= 2
        vertices = shape.project(vertices, spacing, 1)
    return _with_mirror_image(vertices, triangles)


def _half(
    shape: Shape, low: tuple[float, float, float], high: tuple[float, float, float], spacing: float
) -> tuple[Float64, Int32]:
    """Return the surface net of the half x ≥ 0 of the shape. The net's boundary lies exactly in the plane x = 0."""
    origin = np.array([-spacing / 2, low[1], low[2]])  # the plane x = 0 halves the first layer of cells
    count = np.ceil((np.array(high) - origin) / spacing).astype(int) + 1
    points = origin + spacing * np.ascontiguousarray(np.indices(count).reshape(3, -1).T)
    values = shape.distance(points).reshape(count)
    inside = values < 0
    cells = tuple(n - 1 for n in values.shape)
    code = np.zeros(cells, np.uint8)  # for each cell, a bit for each corner that lies inside the shape
    for bit, (i, j, k) in enumerate(_CORNERS):
        code |= inside[i : i + cells[0], j : j + cells[1], k : k + cells[2]].astype(np.uint8) << np.uint8(bit)
    crossed = np.argwhere((code > 0) & (code < 255))  # (N, 3) cells
    vertices, first, sheet = _net(values, crossed, code[tuple(crossed.T)])
    vertices = origin + spacing * vertices
    number = np.full(cells, -1, np.int32)
    number[tuple(crossed.T)] = np.arange(len(crossed), dtype=np.int32)
    quads = np.concatenate([_quads(inside, number, first, sheet, axis) for axis in range(3)])
    return vertices, _triangles(vertices, quads)


def _connected(vertices: Float64, triangles: Int32) -> tuple[Float64, Int32]:
    """Return the largest connected component. On a coarse grid, the thin tip of a horn can be a separate component."""
    component = _core.components(len(vertices), triangles, np.zeros((0, 2), np.int32))
    kept = component == np.bincount(component).argmax()
    number = np.cumsum(kept, dtype=np.int32) - np.int32(1)
    return vertices[kept], number[triangles[kept[triangles[:, 0]]]]


def _net(values: Float64, crossed: Int64, code: UInt8) -> tuple[Float64, Int64, Int64]:
    """Return the vertices (V, 3) in grid spacings, each cell's first vertex (N,), and each edge's sheet (N, 12).

    `crossed` (N, 3) are the cells that the surface crosses, and `code` (N,) has a bit for each corner that lies inside.
    Each edge of a cell has the index of the sheet that crosses it, counted in this cell; −1 if no surface crosses it.
    """
    sheet = _sheets()[code]
    count = sheet.max(axis=1) + 1
    first = np.cumsum(count) - count
    corners = crossed[:, None] + _CORNERS
    at_corner = values[corners[..., 0], corners[..., 1], corners[..., 2]]  # (N, 8)
    summed, crossings = np.zeros((count.sum(), 3)), np.zeros(count.sum())
    for edge, (_, a, b) in enumerate(_EDGES):
        cut = np.flatnonzero(sheet[:, edge] >= 0)
        fraction = at_corner[cut, a] / (at_corner[cut, a] - at_corner[cut, b])
        vertex = first[cut] + sheet[cut, edge]  # the entries are distinct, so += is correct
        summed[vertex] += _CORNERS[a] + fraction[:, None] * (_CORNERS[b] - _CORNERS[a])
        crossings[vertex] += 1
    vertices = np.repeat(crossed, count, axis=0) + summed / crossings[:, None]
    vertices[np.repeat(crossed[:, 0] == 0, count), 0] = 0.5  # on the mirror plane x = 0
    return vertices, first, sheet


@cache
def _sheets() -> Int64:
    """Return a table (256, 12): for each set of inside corners, the sheet that crosses each edge, −1 for none."""
    table = np.full((256, 12), -1)
    for code in range(1, 255):
        cut = [edge for edge, (_, a, b) in enumerate(_EDGES) if (code >> a & 1) != (code >> b & 1)]
        sheet = {edge: edge for edge in cut}
        for axis in range(3):
            for side in (0, 1):
                on_face = [edge for edge in cut if all(_CORNERS[c][axis] == side for c in _EDGES[edge][1:])]
                for edge in on_face:
                    for other in on_face:
                        # If all four edges of a cell's face are crossed, the face's inside corners are not connected.
                        shared = set(_EDGES[edge][1:]) & set(_EDGES[other][1:])
                        if len(on_face) == 2 or any(code >> corner & 1 for corner in shared):
                            old, new = sheet[edge], sheet[other]
                            sheet = {key: new if value == old else value for key, value in sheet.items()}
        names = sorted(set(sheet.values()))
        for edge, value in sheet.items():
            table[code, edge] = names.index(value)
    return table


def _quads(inside: Bool, number: Int32, first: Int64, sheet: Int64, axis: int) -> Int32:
    """Return quadrilaterals (Q, 4), with outward normals, around the crossed grid edges along `axis`."""
    begin, end = [slice(None)] * 3, [slice(None)] * 3
    begin[axis], end[axis] = slice(None, -1), slice(1, None)
    starts = inside[tuple(begin)]
    edges = np.argwhere(starts != inside[tuple(end)])
    u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
    edges = edges[(edges[:, (axis + 1) % 3] > 0) & (edges[:, (axis + 2) % 3] > 0)]
    columns = []
    for offset in (u + v, v, 0 * u, u):  # position of the edge in each of the four cells that share it
        cell = number[tuple((edges - offset).T)]
        start = int(offset @ (4, 2, 1))
        columns.append(first[cell] + sheet[cell, _EDGES.index((axis, start, start + (4, 2, 1)[axis]))])
    quads = np.stack(columns, axis=1).astype(np.int32)
    starts_inside = starts[tuple(edges.T)]
    return np.where(starts_inside[:, None], quads, quads[:, ::-1])


def _triangles(vertices: Float64, quads: Int32) -> Int32:
    """Return the triangles (2 Q, 3) of `quads` (Q, 4), divided along their shorter diagonals."""
    a, b, c, d = (vertices[quads[:, i]] for i in range(4))
    first = ((a - c) ** 2).sum(axis=1) <= ((b - d) ** 2).sum(axis=1)
    cut = np.where(first[:, None], quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [1, 2, 3, 1, 3, 0]])
    return cut.reshape(-1, 3)


def _smoothed(shape: Shape, vertices: Float64, triangles: Int32, spacing: float) -> Float64:
    """Return the vertices after three steps, each halfway to the mean of their neighbors and back to the surface."""
    vertices = shape.project(vertices, spacing, 2)
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    starts, ends = np.concatenate([sides, sides[:, ::-1]]).T
    neighbors = np.bincount(starts, minlength=len(vertices))[:, None]
    for last in (False, False, True):
        middle = group_sums(starts, vertices[ends], len(vertices)) / neighbors
        middle[vertices[:, 0] == 0, 0] = 0.0
        vertices = shape.project((vertices + middle) / 2, spacing / 2, 2 if last else 1)
    return vertices


def _with_mirror_image(vertices: Float64, triangles: Int32) -> tuple[Float64, Int32]:
    """Return the given half of a mesh and its mirror image, joined at the vertices with x = 0."""
    off_plane = vertices[:, 0] > 0
    image = np.arange(len(vertices), dtype=np.int32)
    image[off_plane] = len(vertices) + np.arange(off_plane.sum(), dtype=np.int32)
    mirrored = vertices[off_plane] * np.array([-1.0, 1.0, 1.0])
    return np.concatenate([vertices, mirrored]), np.concatenate([triangles, image[triangles][:, ::-1]])
