"""Where pictures are taken from, and what is written on them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE
from PIL import Image

from dfd.mesh.mesh import Mesh
from dfd.pictures.colors import part_colors
from dfd.pictures.contact_sheet import lay_out
from dfd.pictures.pick import pick
from dfd.pictures.picture import picture, save_png
from dfd.pictures.picture_document import KEY, PictureDocument, ViewDocument, read_document
from dfd.pictures.viewpoint import viewpoint

MESH = Mesh(10 * CORNERS + 100, CUBE)
SIDE = {"azimuth": 30.0, "elevation": 20.0}


def changed(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels in which two pictures differ."""
    rows, columns = np.nonzero(np.abs(one.astype(int) - other).max(axis=2) > 30)
    return rows, columns


@pytest.mark.parametrize("zoom", [0.5, 1.0, 3.0])
def test_the_viewpoint_is_the_one_of_the_picture(zoom) -> None:
    where = {**SIDE, "zoom": zoom, "target": MESH.vertices[7]}
    camera = viewpoint(MESH, **where)
    plain = picture(MESH, resolution=200, **where)
    row, column = camera.project(MESH.vertices[[7]], 200)
    np.testing.assert_allclose([row[0], column[0]], 99.5, atol=1e-3)
    rows, columns = changed(plain, picture(MESH, resolution=200, handles=[7], **where))
    np.testing.assert_allclose([rows.mean(), columns.mean()], 99.5, atol=1.0)


def test_labels_stand_beside_their_handles() -> None:
    plain = picture(MESH, handles=[7], resolution=200, **SIDE)
    labelled = picture(MESH, handles=[7], labels=["12"], resolution=200, **SIDE)
    row, column = viewpoint(MESH, **SIDE).project(MESH.vertices[[7]], 200)
    rows, columns = changed(plain, labelled)
    assert len(rows) > 10
    assert np.hypot(rows - row[0], columns - column[0]).max() < 40
    with pytest.raises(ValueError, match="`labels` must be as many as `handles`, got 2"):
        picture(MESH, handles=[7], labels=["1", "2"])


def test_a_sheet_says_where_its_pictures_are() -> None:
    red, blue = (np.full((32, 32, 3), ink, np.uint8) for ink in ((255, 0, 0), (0, 0, 255)))
    for title in ("", "a title"):
        page, boxes = lay_out(
            [("one", [(red, "a"), (blue, "b")]), ("", []), ("two", [(blue, "")])], title=title, cell=32
        )
        assert [len(row) for row in boxes] == [2, 1]
        for (left, top, width, height), ink in zip([*boxes[0], *boxes[1]], (red, blue, blue), strict=True):
            assert (width, height) == (32, 32)
            np.testing.assert_array_equal(np.asarray(page)[top : top + 32, left : left + 32], ink)


def test_every_corner_of_a_picture_is_picked(tmp_path) -> None:
    camera = viewpoint(MESH, **SIDE)
    document = PictureDocument.of(MESH, [ViewDocument.of(camera, (0, 0, 300), "resting")])
    save_png(tmp_path / "box.png", picture(MESH, resolution=300, **SIDE), document)
    assert read_document(tmp_path / "box.png") == document
    rows, columns = camera.project(MESH.vertices, 300)
    middle = np.array([rows.mean(), columns.mean()])
    found = set()
    for row, column in zip(rows, columns, strict=True):
        y, x = np.array([row, column]) + 0.05 * (middle - [row, column])
        found.add(pick(tmp_path / "box.png", x, y, MESH).vertex)
    assert len(found) >= 7  # all but the one behind
    with pytest.raises(ValueError, match="`mesh` must be given: the picture does not say where its own is"):
        pick(tmp_path / "box.png", 150, 150)


def test_what_a_picture_says_is_checked(tmp_path) -> None:
    from PIL.PngImagePlugin import PngInfo

    document = PictureDocument.of(MESH, [ViewDocument.of(viewpoint(MESH), (0, 0, 9), "resting")])
    for key, value, name in (("version", 2, "version"), ("hash", 5, "hash"), ("more", 1, "more")):
        said = PngInfo()
        said.add_itxt(KEY, json.dumps({**document.model_dump(mode="json"), key: value}))
        Image.new("RGB", (9, 9)).save(tmp_path / "odd.png", pnginfo=said)
        with pytest.raises(ValueError, match=f"odd: `{name}`"):
            read_document(tmp_path / "odd.png")


def test_parts_have_colors_of_their_own():
    colors = part_colors(np.arange(24))
    apart = np.abs(colors[:, None] - colors).max(axis=2) + np.eye(24)
    assert apart.min() > 0.02
    assert np.array_equal(part_colors([3, 0, 3]), colors[[3, 0, 3]])
    with pytest.raises(ValueError, match="part_colors: `labels` must be at least 0, got -1"):
        part_colors([0, -1])
