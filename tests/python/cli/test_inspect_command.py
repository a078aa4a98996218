"""Test `dfd inspect`."""

import json
import re
from unittest import mock

import numpy as np
import pytest
from command_runs import drawn, failed, worked
from mesh_files import CORNERS, CUBE

import dfd
from dfd import Mesh, SymmetryPlane
from dfd.cli.inspect import sides_and_ends
from dfd.pictures.picture import picture


def test_inspect_prints_five_lines(run, folder):
    result = run("inspect", "MESH", "--field", "FIELD")
    assert worked(result)
    assert result.stderr == ""
    mesh, box, up, field, planes = result.stdout.splitlines()
    assert mesh.endswith("chair.obj: 2,004 vertices, 4,008 faces, 1 component, closed, 0.500684 × 0.989675 × 0.535896")
    assert re.fullmatch(r"box: from -0.25\d*,0.031\d*,-0.2\d* to 0.25\d*,1.02\d*,0.2\d*", box)
    assert up.startswith("up: +y")
    assert field == f"field: {folder / 'chair.field.safetensors'}, 16 dimensions, none"
    assert planes.startswith("symmetry planes: ")
    assert len(run("inspect", "MESH").stdout.splitlines()) == 3


def test_inspect_names_the_vertex_under_a_pixel_of_the_picture_that_show_draws(run, chair):
    look = ("--azimuth", 20, "--elevation", 30, "--resolution", 96)
    assert worked(run("show", "MESH", *look, "-o", "show.png"))
    result = run("inspect", "MESH", "--json", *look, "--picture", "inspect.png", "--at", 40, 30)
    assert worked(result)
    np.testing.assert_array_equal(drawn("inspect.png"), drawn("show.png"))
    report = json.loads(result.stdout)
    assert report["box"] == {"minimum": chair.bounds[0].tolist(), "maximum": chair.bounds[1].tolist()}
    found = report["at"]
    # A mark at the point lies at the pixel.
    image = picture(chair, azimuth=20, elevation=30, resolution=96, handles=[found["point"]])
    rows, columns = np.nonzero(np.abs(image - drawn("show.png")).max(axis=2) > 100)
    assert (columns.mean(), rows.mean()) == pytest.approx((40, 30), abs=1)
    assert found["vertex"] in chair.faces[found["face"]]
    assert "pixel 0 0: no surface" in run("inspect", "MESH", "--at", 0, 0).stdout
    assert failed(run("inspect", "MESH", "--at", 768, 0), "`--at` must lie in 0 … 767, got 768 0")


@pytest.mark.slow
def test_inspect_prints_json_with_the_planes_of_a_field(run, folder):
    with mock.patch("dfd.symmetry.search.RELATIVE_THRESHOLD", 10.0):  # accept any plane, because the field is untrained
        result = run("inspect", "MESH", "--field", "FIELD", "--json")
        table = run("inspect", "MESH", "--field", "FIELD")
    assert worked(result)
    report = json.loads(result.stdout)
    assert report["file"] == str(folder / "chair.obj")
    assert report["vertex_count"] == 2004
    assert report["components"] == 1
    assert report["field"]["dimension"] == 16
    assert report["field"]["settings"] == {"encoder": "none", "seed": 3}
    planes = report["symmetry_planes"]
    assert planes
    np.testing.assert_allclose([np.linalg.norm(plane["normal"]) for plane in planes], 1)
    assert worked(table)
    assert table.stdout.count("(score") == len(planes)


def test_inspect_says_what_is_odd(run):
    Mesh(CORNERS, CUBE[:-1]).save("open.obj")
    result = run("inspect", "open.obj")
    assert worked(result)
    text = " ".join(result.stdout.split())
    assert "odd: The surface is open: 3 edges have one face only." in text
    report = json.loads(run("inspect", "open.obj", "--json").stdout)
    assert any("open" in each["what"] for each in report["findings"])


X, Y, Z = (SymmetryPlane(normal, 0.0) for normal in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
OBLIQUE = SymmetryPlane((np.sqrt(0.5), 0.0, np.sqrt(0.5)), 0.0)


@pytest.mark.parametrize(
    ("planes", "up", "found"),
    [
        ([X], (0, 1, 0), (0, 2)),
        ([Z, Y], (0, 1, 0), (2, 0)),  # a plane that lies flat says nothing
        ([X], (0, 0, 1), (0, 1)),
        ([X, Z], (0, 1, 0), None),
        ([OBLIQUE], (0, 1, 0), None),
        ([Y], (0, 1, 0), None),
        ([], (0, 1, 0), None),
    ],
)
def test_sides_and_ends_come_from_the_only_upright_plane(planes, up, found):
    assert sides_and_ends(planes, np.array(up, float)) == found


def test_inspect_names_the_words_for_the_sides_and_the_ends(run, monkeypatch):
    monkeypatch.setattr(dfd, "symmetry_planes", lambda mesh, field: [Z], raising=False)
    said = run("inspect", "MESH", "--field", "FIELD", "--up", "file").stdout.splitlines()[-1]
    assert said == "sides, by the upright symmetry plane: `front` and `back`; ends: `left` and `right`"
    report = json.loads(run("inspect", "MESH", "--field", "FIELD", "--up", "file", "--json").stdout)
    assert (report["sides"], report["ends"]) == ("z", "x")
