"""Test that parts are a function of the shape: not of the order, scale, place or copies of vertices and faces."""

from functools import partial

import numpy as np
import pytest

import dfd
from dfd.mesh.normals import smooth_normals
from dfd.segmentation.parts import Parts
from dfd.symmetry.plane import SymmetryPlane

PLACES = 6


def looks(sample):
    """Return features (V, 16) that depend on the part, and a little on the position."""
    random = np.random.default_rng(0)
    rows = random.normal(size=(len(sample.parts), 16))[sample.labels]
    rows = rows + 0.3 * np.cos(5 * np.abs(sample.mesh.vertices) @ random.normal(size=(3, 16)))
    rows = rows + rows[mirrored(sample.mesh)]
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def mirrored(mesh):
    """Return the mirror image (V,) of each vertex in the plane x = 0."""
    from scipy.spatial import cKDTree

    return cKDTree(mesh.vertices).query(mesh.vertices * (-1, 1, 1))[1]


@pytest.fixture(scope="module")
def animal():
    return dfd.samples.quadruped(6_000)


@pytest.fixture(scope="module")
def rows(animal):
    return looks(animal)


def plane_at(offset=0.0):
    return SymmetryPlane((1.0, 0.0, 0.0), offset)


def parts_of(vertices, faces, rows, plane=None):
    planes = (plane or plane_at(),)
    return Parts(dfd.Mesh(vertices, faces), lambda some: rows[some], lambda: planes)


@pytest.fixture(scope="module")
def expected(animal, rows):
    """Return the places, and the masks of the parts there at levels −1, 0 and 1."""
    parts = parts_of(animal.mesh.vertices, animal.mesh.faces, rows)
    places = np.random.default_rng(1).choice(len(rows), PLACES, replace=False)
    return places, masks_at(parts, places)


def masks_at(parts, places):
    return [[parts.part(int(place), level).mask for level in (-1, 0, 1)] for place in places]


def renumbered(vertices, faces, random):
    order = random.permutation(len(vertices))
    return vertices[order], np.argsort(order)[faces], order, 0.0


def with_faces_in_another_order(vertices, faces, random):
    turned = np.stack([np.roll(face, int(random.integers(3))) for face in faces[random.permutation(len(faces))]])
    return vertices, turned, np.arange(len(vertices)), 0.0


def with_doubled_faces(vertices, faces, random):
    some = faces[random.choice(len(faces), len(faces) // 3, replace=False)]
    return vertices, np.concatenate([faces, some, some[:, ::-1]]), np.arange(len(vertices)), 0.0


def with_reversed_copies_first(vertices, faces, random):
    some = faces[random.choice(len(faces), len(faces) // 3, replace=False), ::-1]
    return vertices, np.concatenate([some, faces]), np.arange(len(vertices)), 0.0


def with_unused_vertices(vertices, faces, random):
    more = random.uniform(vertices.min(axis=0), vertices.max(axis=0), (500, 3))
    return np.concatenate([vertices, more]), faces, np.append(np.arange(len(vertices)), np.zeros(500, int)), 0.0


def with_split_seams(vertices, faces, random):
    split = np.flatnonzero(vertices[faces].mean(axis=1)[:, 1] > 0.5)
    new = faces.copy()
    corners, inverse = np.unique(faces[split], return_inverse=True)
    new[split] = len(vertices) + inverse.reshape(-1, 3)
    return np.concatenate([vertices, vertices[corners]]), new, np.append(np.arange(len(vertices)), corners), 0.0


def scaled(vertices, faces, random):
    return 1e-3 * vertices, faces, np.arange(len(vertices)), 0.0


def shifted(vertices, faces, random):
    far = 1_000 * float(np.ptp(vertices, axis=0).max())
    return vertices + far, faces, np.arange(len(vertices)), far


def inside_out(vertices, faces, random):
    return vertices, faces[:, ::-1], np.arange(len(vertices)), 0.0


def with_a_third_flipped(vertices, faces, random):
    return (
        vertices,
        np.where(random.random((len(faces), 1)) < 1 / 3, faces[:, ::-1], faces),
        np.arange(len(vertices)),
        0.0,
    )


def hollow(vertices, faces, random):
    """Add an inner wall, which looks inwards, 0.4 % of the diagonal inside."""
    depth = 0.004 * np.linalg.norm(np.ptp(vertices, axis=0))
    inner = vertices - depth * smooth_normals(vertices, faces)
    walls = np.concatenate([faces, faces[:, ::-1] + len(vertices)])
    return np.concatenate([vertices, inner]), walls, np.tile(np.arange(len(vertices)), 2), 0.0


def cut(vertices, faces, random, gap):
    """Move four quadrants apart by `gap` diagonals."""
    middles = vertices[faces].mean(axis=1)
    quadrant = 2 * (middles[:, 0] > 0) + (middles[:, 2] > 0)
    corners, inverse = np.unique(quadrant[:, None] * len(vertices) + faces, return_inverse=True)
    number, old = np.divmod(corners, len(vertices))
    apart = gap * np.linalg.norm(np.ptp(vertices, axis=0)) * np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, -1], [1, 0, 1]])
    return vertices[old] + apart[number], inverse.reshape(-1, 3), old, 0.0


def with_fins(vertices, faces, random):
    """Add 30 faces, each on an edge of two others."""
    edges = faces[random.choice(len(faces), 30, replace=False)][:, :2]
    ends = vertices[edges]
    out = 2 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[:, None]
    tips = ends.mean(axis=1) + out * smooth_normals(vertices, faces)[edges[:, 0]]
    fins = np.column_stack([edges, len(vertices) + np.arange(30)])
    old = np.append(np.arange(len(vertices)), edges[:, 0])
    return np.concatenate([vertices, tips]), np.concatenate([faces, fins]), old, 0.0


@pytest.mark.parametrize(
    "change",
    [
        *(inside_out, with_a_third_flipped, hollow, with_fins),
        *(pytest.param(partial(cut, gap=gap), id=f"cut, moved by {gap:g}") for gap in (1e-9, 1e-4)),
        renumbered,
        with_faces_in_another_order,
        with_doubled_faces,
        with_reversed_copies_first,
        with_unused_vertices,
        with_split_seams,
        scaled,
        shifted,
    ],
)
def test_the_same_shape_has_the_same_parts(animal, rows, expected, change):
    """`change` returns vertices and faces, the old index of each new vertex, and the offset of the mirror plane."""
    places, masks = expected
    vertices, faces, old, offset = change(animal.mesh.vertices, animal.mesh.faces, np.random.default_rng(2))
    first = np.argsort(old, kind="stable")[np.searchsorted(np.sort(old), np.arange(len(animal.mesh.vertices)))]
    parts = parts_of(vertices, faces, rows[old], plane_at(offset))
    for own, found in zip(masks, masks_at(parts, first[places]), strict=True):
        for one, other in zip(own, found, strict=True):
            assert np.array_equal(one, other[first])
            if change is hollow:
                assert np.array_equal(one[old], other)


def test_a_turned_shape_has_nearly_the_same_parts(animal, rows, expected):
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    plane = SymmetryPlane(tuple(turn[:, 0] * np.sign(turn[np.abs(turn[:, 0]).argmax(), 0])), 0.0)
    parts = parts_of(animal.mesh.vertices @ turn.T, animal.mesh.faces, rows, plane)
    places, masks = expected
    found = masks_at(parts, places)
    overlap = [
        (one & two).sum() / (one | two).sum()
        for a, b in zip(masks, found, strict=True)
        for one, two in zip(a, b, strict=True)
    ]
    assert np.mean(overlap) > 0.98


def test_parts_of_a_mirrored_shape_are_mirror_images(animal, rows, expected):
    mates = mirrored(animal.mesh)
    parts = parts_of(animal.mesh.vertices, animal.mesh.faces, rows)
    places, masks = expected
    for own, found in zip(masks, masks_at(parts, mates[places]), strict=True):
        for one, other in zip(own, found, strict=True):
            assert np.array_equal(one[mates], other)
