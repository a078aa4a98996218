"""Test the measures of distortion."""

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE

from bench.paper.distortion import surface_metrics
from dfd import Mesh

BOX = Mesh(CORNERS, CUBE)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_rigid_motion_changes_nothing(size):
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])
    mesh = Mesh(size * BOX.vertices, CUBE)
    found = surface_metrics(mesh, mesh.vertices @ turn.T + 3 * size)
    assert max(map(abs, found.values())) < 1e-4


def test_a_box_stretched_along_one_axis():
    found = surface_metrics(BOX, BOX.vertices * [2, 1, 1])
    assert found["area %"] == pytest.approx(400 / 6)  # the area of four of six sides doubles
    assert found["volume %"] == pytest.approx(100)
    # The halves of a square have angles of 45°, 45° and 90°; those of a stretched square have 26.57°, 63.43° and 90°.
    assert found["angle °"] == pytest.approx(4 / 6 * 2 / 3 * 18.4349488)
    np.testing.assert_allclose(surface_metrics(BOX, BOX.vertices * 3)["edge %"], 200)
    assert found["flipped faces"] == 0


def test_a_face_that_is_folded_over_is_counted():
    grid = np.stack([*np.meshgrid(np.arange(5.0), np.arange(5.0)), np.zeros((5, 5))], axis=-1).reshape(-1, 3)
    quads = [(r * 5 + c, r * 5 + c + 1, r * 5 + c + 6, r * 5 + c + 5) for r in range(4) for c in range(4)]
    mesh = Mesh(grid, [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    moved = grid.copy()
    moved[12] += [1.6, 1.6, 0]  # the middle vertex, moved beyond its neighbors
    found = surface_metrics(mesh, moved)
    assert found["flipped faces"] >= 2
    assert found["volume %"] is None
    assert surface_metrics(mesh, grid[:, [1, 0, 2]])["flipped faces"] == 0
