"""The coarse level: few faces over the mesh's own vertices, of every piece some."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import dfd
from dfd.app.session.level_of_detail import MOST_FACES, CoarseLevel, coarse_level
from dfd.mesh.mesh import Mesh

Arrays = tuple[NDArray[np.float64], NDArray[np.int32]]


def checked(vertices: NDArray[np.float64], faces: NDArray[np.int32], most: int) -> CoarseLevel:
    """The level, which must be sound."""
    given = vertices.copy(), faces.copy()
    level = coarse_level(vertices, faces, max_faces=most)
    np.testing.assert_array_equal(vertices, given[0], err_msg="inputs unchanged")
    np.testing.assert_array_equal(faces, given[1], err_msg="inputs unchanged")
    assert level is not None
    assert np.isin(level.faces, faces).all(), "only vertices that have faces"
    assert len(level.faces) == len(level.source_faces) > 0
    assert 2 * len(level.faces) <= len(faces)
    assert (level.source_faces >= 0).all()
    assert (level.source_faces < len(faces)).all()
    ordered = np.sort(level.faces, axis=1)
    assert (np.diff(ordered, axis=1) > 0).all(), "three corners each"
    assert len(np.unique(ordered, axis=0)) == len(ordered), "every face once"
    return level


def arrays(mesh: Any) -> Arrays:
    return np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int32)


def test_a_large_shape_keeps_its_form_in_few_faces() -> None:
    mesh = dfd.samples.chair(60_000).mesh
    vertices, faces = arrays(mesh)
    level = checked(vertices, faces, MOST_FACES)
    assert 0.5 * MOST_FACES < len(level.faces) < 1.2 * MOST_FACES
    from scipy.spatial import cKDTree

    gaps = cKDTree(vertices[level.faces].mean(axis=1)).query(vertices)[0]
    assert gaps.max() < 0.03 * mesh.diagonal


def test_faces_look_the_way_that_those_they_stand_for_do() -> None:
    vertices, faces = arrays(trimesh.creation.icosphere(subdivisions=6))
    level = checked(vertices, faces, 4000)
    a, b, c = (vertices[level.faces[:, k]] for k in range(3))
    outward = (np.cross(b - a, c - a) * (a + b + c)).sum(axis=1)
    assert (outward > 0).mean() > 0.99


def test_every_piece_keeps_something() -> None:
    big = trimesh.creation.icosphere(subdivisions=5)
    specks = []
    for k in range(40):
        speck = trimesh.creation.icosphere(subdivisions=1, radius=1e-4)
        speck.apply_translation([2.0 + 0.1 * k, 0, 0])
        specks.append(speck)
    whole = trimesh.util.concatenate([big, *specks])
    vertices, faces = arrays(whole)
    level = checked(vertices, faces, 4000)
    near = np.rint((vertices[level.faces[:, 0], 0] - 2.0) / 0.1).astype(int)
    assert set(range(40)) <= set(near.tolist())


def test_what_is_thinner_than_a_cube_is_still_one_line() -> None:
    wire = trimesh.creation.cylinder(radius=1e-4, height=4.0, sections=6).subdivide_to_size(0.02, max_iter=20)
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.5)
    vertices, faces = arrays(trimesh.util.concatenate([ball, wire]))
    level = checked(vertices, faces, 3000)
    heights = vertices[level.faces][:, :, 2]
    for height in np.linspace(0.6, 1.9, 50):
        assert ((heights.min(axis=1) <= height) & (heights.max(axis=1) >= height)).any(), f"a gap at {height}"


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_units_do_not_matter(scale: float) -> None:
    vertices, faces = arrays(trimesh.creation.icosphere(subdivisions=5))
    expected = checked(vertices, faces, 2000)
    found = checked(vertices * scale, faces, 2000)
    np.testing.assert_array_equal(found.faces, expected.faces)


def test_small_shapes_have_none() -> None:
    assert coarse_level(*arrays(trimesh.creation.icosphere(subdivisions=3))) is None
    assert coarse_level(np.zeros((0, 3)), np.zeros((0, 3), np.int32)) is None
    assert coarse_level(np.zeros((1, 3)), np.zeros((0, 3), np.int32)) is None


def test_shapes_without_an_area_have_none() -> None:
    faces = np.tile(np.array([[0, 1, 2]], np.int32), (5000, 1))
    assert coarse_level(np.ones((3, 3)), faces, max_faces=100) is None, "all in one point"
    line = np.column_stack([np.linspace(0, 1, 5000), np.zeros(5000), np.zeros(5000)])
    along = np.arange(4998, dtype=np.int32)[:, None] + np.array([0, 1, 2], np.int32)
    assert coarse_level(line, along, max_faces=100) is None, "all on one line"


def test_a_flat_shape_has_one() -> None:
    grid = np.stack(np.meshgrid(np.arange(100.0), np.arange(100.0)), axis=-1).reshape(-1, 2)
    vertices = np.column_stack([grid, np.full(len(grid), 3.0)])
    corner = (np.arange(99)[:, None] * 100 + np.arange(99)).reshape(-1, 1)
    faces = np.concatenate([corner + [0, 1, 100], corner + [1, 101, 100]]).astype(np.int32)
    level = checked(vertices, faces, 1000)
    a, b, c = (vertices[level.faces[:, k]] for k in range(3))
    covered = np.abs(np.cross(b - a, c - a)[:, 2]).sum() / 2
    assert covered > 0.9 * 99 * 99


def test_what_is_no_number_is_refused_before() -> None:
    vertices, faces = arrays(trimesh.creation.icosphere(subdivisions=1))
    vertices[3, 1] = np.nan
    with pytest.raises(ValueError, match="vertices"):
        Mesh(vertices, faces)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 400), st.integers(1, 60))
def test_soups_of_triangles(seed: int, count: int, most: int) -> None:
    random = np.random.default_rng(seed)
    vertices = random.standard_normal((count, 3)) * random.choice([1e-6, 1.0, 1e6], 3)
    faces = random.integers(0, count, (2000, 3)).astype(np.int32)
    if coarse_level(vertices, faces, max_faces=most) is not None:
        checked(vertices, faces, most)
