"""Test the camera of pictures, and the labels on them."""

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE

from dfd.mesh.mesh import Mesh
from dfd.pictures.colors import part_colors
from dfd.pictures.picture import picture
from dfd.pictures.viewpoint import aim

MESH = Mesh(10 * CORNERS + 100, CUBE)
SIDE = {"azimuth": 30.0, "elevation": 20.0}


def projected(*, zoom=1.0, target=None):
    """Return the row and the column of vertex 7 in a picture of 200 × 200 pixels."""
    frame, camera = aim(MESH, MESH.vertices, **SIDE, zoom=zoom, target=target, frame=())
    return camera.project(frame.apply(MESH.vertices[[7]]), 200)


def changed(one, other):
    """Return the rows and the columns of all pixels in which two pictures differ."""
    rows, columns = np.nonzero(np.abs(one.astype(int) - other).max(axis=2) > 30)
    return rows, columns


@pytest.mark.parametrize("zoom", [0.5, 1.0, 3.0])
def test_the_camera_is_centered_on_the_target(zoom):
    where = {**SIDE, "zoom": zoom, "target": MESH.vertices[7]}
    plain = picture(MESH, resolution=200, **where)
    row, column = projected(zoom=zoom, target=MESH.vertices[7])
    np.testing.assert_allclose([row[0], column[0]], 99.5, atol=1e-3)
    rows, columns = changed(plain, picture(MESH, resolution=200, handles=[7], **where))
    np.testing.assert_allclose([rows.mean(), columns.mean()], 99.5, atol=1.0)


def test_labels_stand_beside_their_handles():
    plain = picture(MESH, handles=[7], resolution=200, **SIDE)
    labelled = picture(MESH, handles=[7], labels=["12"], resolution=200, **SIDE)
    row, column = projected()
    rows, columns = changed(plain, labelled)
    assert len(rows) > 10
    assert np.hypot(rows - row[0], columns - column[0]).max() < 40
    with pytest.raises(ValueError, match="`labels` must have one text for each of `handles`, got 2"):
        picture(MESH, handles=[7], labels=["1", "2"])


def test_parts_have_colors_of_their_own():
    colors = part_colors(np.arange(24))
    apart = np.abs(colors[:, None] - colors).max(axis=2) + np.eye(24)
    assert apart.min() > 0.02
    assert np.array_equal(part_colors([3, 0, 3]), colors[[3, 0, 3]])
    with pytest.raises(ValueError, match="part_colors: `labels` must be at least 0, got -1"):
        part_colors([0, -1])
