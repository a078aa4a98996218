"""`dfd pick`."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_runs import drawn, failed, worked
from PIL import Image

import dfd
from dfd.pictures.viewpoint import viewpoint


@pytest.fixture
def heat(run):
    arguments = ("--handle", 40, "--azimuth", 20, "--resolution", 200, "--legend", "-o", "heat.png")
    assert worked(run("show", "MESH", "--field", "FIELD", *arguments))
    return "heat.png"


def said(path):
    with Image.open(path) as image:
        return json.loads(image.info["dfd-picture"])["views"]


def pixel_of(mesh, vertex, resolution, **where):
    row, column = viewpoint(mesh, **where).project(mesh.vertices[[vertex]], resolution)
    return float(column[0]), float(row[0])


def test_a_pixel_is_the_vertex_that_is_seen_there(run, heat, chair):
    front = int((chair.vertices @ [0.3, 0.2, 1.0]).argmax())
    x, y = pixel_of(chair, front, 200, azimuth=20, elevation=15)
    result = run("pick", heat, x, y, "--json")
    assert worked(result)
    found = json.loads(result.stdout)
    assert found["vertex"] == front
    assert found["position"] == chair.vertices[front].tolist()
    assert found["distance"] < 0.01
    np.testing.assert_allclose(found["point"], chair.vertices[front], atol=0.01)
    assert f"vertex {front} at " in run("pick", heat, round(x), round(y)).stdout


def test_every_picture_of_a_sheet_has_its_own_camera(run, chair):
    arguments = ("--views", 3, "--azimuth", 0, "--elevation", 0, "--resolution", 100, "-o", "sheet.png")
    assert worked(run("show", "MESH", "--handle", 40, *arguments))
    views = said("sheet.png")
    assert [view["side"] for view in views] == [100] * 3
    for view, azimuth in zip(views, (0, 120, 240), strict=True):
        turn = np.radians(azimuth)
        vertex = int((chair.vertices @ [np.sin(turn), 0.1, np.cos(turn)]).argmax())
        x, y = pixel_of(chair, vertex, 100, azimuth=azimuth, elevation=0)
        found = json.loads(run("pick", "sheet.png", view["left"] + x, view["top"] + y, "--json").stdout)
        assert np.linalg.norm(chair.vertices[found["vertex"]] - chair.vertices[vertex]) < 0.05


@pytest.mark.slow
def test_the_moved_shape_is_picked_from_its_own_file(run):
    move = ("--handle", 40, "--translate", 0, 0.5, 0, "--picture", "pair.png")
    assert worked(run("deform", "MESH", "--field", "FIELD", *move, "-o", "moved.obj"))
    after = said("pair.png")[-1]
    assert after["shape"] == "moved"
    moved = dfd.load("moved.obj")
    x, y = after["left"] + after["side"] / 2, after["top"] + after["side"] / 2
    pixels = drawn("pair.png").mean(axis=2)
    column = next(c for c in range(round(x) - 300, round(x) + 300) if pixels[round(y), c] < 200)
    found = json.loads(run("pick", "pair.png", column + 6, y, "--json").stdout)
    np.testing.assert_allclose(found["position"], moved.vertices[found["vertex"]])
    assert worked(run("deform", "MESH", "--field", "FIELD", *move))
    assert failed(run("pick", "pair.png", column + 6, y), "`mesh` must be given: this is a view of the moved shape")


def test_a_click_beside_the_shape_is_refused(run, heat):
    assert failed(run("pick", heat, 1, 1), "`x`, `y` must be a pixel of the shape, but 1, 1 is beside it")
    assert failed(run("pick", heat, 5000, 1), "5000, 1 is beside them all")
    assert failed(run("pick", heat, "nan", 1), "`X` must be finite")


def test_pictures_that_say_nothing_and_other_meshes_are_refused(run, heat, folder):
    Image.new("RGB", (9, 9)).save("plain.png")
    assert failed(run("pick", "plain.png", 1, 1), "plain.png: the picture does not say how it was taken")
    Path("text.png").write_text("no picture")
    assert failed(run("pick", "text.png", 1, 1), "text.png is not a PNG file that can be read")
    assert failed(run("pick", "none.png", 1, 1), "none.png: No such file")
    dfd.samples.quadruped(4000).mesh.save("other.obj")
    assert failed(run("pick", heat, 100, 100, "other.obj"), "`mesh` must be the one that the picture shows")
    shutil.copy(folder / "chair.obj", "chair.obj")
    assert worked(
        run("pick", heat, *map(round, pixel_of(dfd.load("chair.obj"), 40, 200, azimuth=20, elevation=15)), "chair.obj")
    )
