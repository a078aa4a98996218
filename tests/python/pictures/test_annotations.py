"""Where pictures are taken from, and what is written on them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE
from PIL import Image

from dfd.mesh.mesh import Mesh
from dfd.pictures.colors import CLAY, part_colors, ratio_colors
from dfd.pictures.contact_sheet import heat_bar, lay_out, with_heat_bar
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


def test_zoom_makes_things_larger() -> None:
    areas = [(picture(MESH, zoom=zoom, resolution=100, **SIDE).min(axis=2) < 250).sum() for zoom in (0.5, 1.0)]
    assert areas[1] / areas[0] == pytest.approx(4, rel=0.1)
    with pytest.raises(ValueError, match="`zoom` must be above 0"):
        picture(MESH, zoom=0)


def test_labels_stand_beside_their_handles() -> None:
    plain = picture(MESH, handles=[7], resolution=200, **SIDE)
    labelled = picture(MESH, handles=[7], labels=["12"], resolution=200, **SIDE)
    row, column = viewpoint(MESH, **SIDE).project(MESH.vertices[[7]], 200)
    rows, columns = changed(plain, labelled)
    assert len(rows) > 10
    assert np.hypot(rows - row[0], columns - column[0]).max() < 40
    with pytest.raises(ValueError, match="`labels` must be as many as `handles`, got 2"):
        picture(MESH, handles=[7], labels=["1", "2"])


def test_numbers_stand_beside_vertices_that_are_seen() -> None:
    where = {"azimuth": 0.0, "elevation": 0.0}
    plain, numbered = (picture(MESH, numbers=on, resolution=300, zoom=0.7, **where) for on in (False, True))
    front = np.flatnonzero(MESH.vertices[:, 2] == MESH.vertices[:, 2].max())
    rows, columns = changed(plain, numbered)
    at_row, at_column = viewpoint(MESH, zoom=0.7, **where).project(MESH.vertices, 300)
    apart = np.hypot(rows[:, None] - at_row[front], columns[:, None] - at_column[front])
    assert apart.min(axis=1).max() < 20  # nothing anywhere else
    assert set(apart.argmin(axis=1)) == set(range(len(front)))


def test_axes_point_where_they_lead() -> None:
    plain, drawn = (picture(MESH, axes=on, azimuth=0, elevation=0, resolution=300) for on in (False, True))
    rows, columns = changed(plain, drawn)
    assert rows.min() > 200
    assert columns.max() < 100
    color = drawn[rows, columns].astype(int)
    red, green = color[:, 0] - color[:, 1:].max(axis=1) > 80, color[:, 1] - color[:, [0, 2]].max(axis=1) > 50
    assert columns[red].mean() > columns[green].mean()  # x to the right of y
    assert rows[green].mean() < rows[red].mean()  # y above x


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


def test_the_heat_bar_stands_at_the_right() -> None:
    image = picture(MESH, weights=np.linspace(0, 1, len(MESH.vertices)), resolution=120)
    wide = with_heat_bar(image)
    np.testing.assert_array_equal(wide[:, :120], image)
    np.testing.assert_array_equal(wide[:, 120 : 120 + heat_bar(120).shape[1]], heat_bar(120))


def test_ratios_are_blue_below_one_and_red_above() -> None:
    half, less, same, twice, more = ratio_colors([0.5, 0, 1, 2, 1e9])
    np.testing.assert_array_equal(half, less)
    np.testing.assert_array_equal(twice, more)
    np.testing.assert_allclose(same, CLAY, atol=1e-6)
    assert half[2] > half[0]
    assert twice[0] > twice[2]
    with pytest.raises(ValueError, match="`ratios` must be finite"):
        ratio_colors([np.nan])


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
