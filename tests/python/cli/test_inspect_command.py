"""`dfd inspect`."""

import json
from unittest import mock

import numpy as np
import pytest
from command_runs import drawn, failed, worked
from mesh_files import CORNERS, CUBE

from dfd import Mesh


def test_inspect_prints_five_lines(run, folder):
    result = run("inspect", "MESH", "--field", "FIELD")
    assert worked(result)
    assert result.stderr == ""
    mesh, up, field, planes, handles = result.stdout.splitlines()
    assert mesh.endswith("chair.obj: 2,004 vertices, 4,008 faces, 1 component, closed, 0.500684 × 0.989675 × 0.535896")
    assert up.startswith("up: +y")
    assert field == f"field: {folder / 'chair.field.safetensors'}, 16 dimensions, none"
    assert planes.startswith("symmetry planes: ")
    assert handles.startswith("handles: vertex ")
    assert len(run("inspect", "MESH").stdout.splitlines()) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vertices", "faces", "line"),
    [
        (
            np.vstack([CORNERS, CORNERS / 2 + 0.25]),
            np.vstack([CUBE, CUBE + 8]),
            "unseen: 20.0% of the surface, 1 of 2 components wholly, in 24 views: it takes the nearest seen features",
        ),
        (
            np.vstack([CORNERS, CORNERS + [0, 0, 1]]),
            np.vstack([CUBE, CUBE + 8]),
            "unseen: 16.7% of the surface, in 24 views: it takes the nearest seen features",
        ),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "unseen: all of it, for no face has an area"),
    ],
)
def test_inspect_says_what_no_camera_sees(run, vertices, faces, line):
    Mesh(vertices, faces).save("shape.obj")
    result = run("inspect", "shape.obj")
    assert worked(result)
    assert line in " ".join(result.stdout.split())


@pytest.mark.slow
def test_inspect_prints_json_with_the_planes_of_a_field(run, folder):
    with mock.patch(
        "dfd.symmetry.search.RELATIVE_THRESHOLD", 10.0
    ):  # every plane will do for a field that learnt nothing
        result = run("inspect", "MESH", "--field", "FIELD", "--json")
        table = run("inspect", "MESH", "--field", "FIELD")
    assert worked(result)
    report = json.loads(result.stdout)
    assert report["file"] == str(folder / "chair.obj")
    assert report["vertex_count"] == 2004
    assert report["components"] == 1
    assert report["unseen"] == {"views": 24, "area": 0, "components": 0, "component_count": 1}
    assert report["field"]["dimension"] == 16
    assert report["field"]["settings"] == {"encoder": "none", "seed": 3}
    assert [1, 0, 0] in [plane["normal"] for plane in report["symmetry_planes"]]
    assert worked(table)
    assert "x=0 (score" in table.stdout


@pytest.mark.slow
def test_inspect_suggests_handles_and_draws_them(run, chair):
    result = run("inspect", "MESH", "--field", "FIELD", "--suggestions", 3, "--picture", "handles.png", "--json")
    assert worked(result)
    report = json.loads(result.stdout)
    assert 1 <= len(report["suggestions"]) <= 3
    first = report["suggestions"][0]
    assert first["position"] == chair.vertices[first["vertex"]].tolist()
    assert 0 < sum(each["share"] for each in report["suggestions"]) <= 1
    assert drawn("handles.png").std() > 10
    table = run("inspect", "MESH", "--field", "FIELD", "--suggestions", 3)
    assert f"handles: vertex {first['vertex']} ({first['share']:.0%}" in table.stdout


def test_inspect_says_what_is_odd(run):
    Mesh(CORNERS, CUBE[:-1]).save("open.obj")
    result = run("inspect", "open.obj")
    assert worked(result)
    text = " ".join(result.stdout.split())
    assert "odd: The surface is open: 3 edges have one face only." in text
    report = json.loads(run("inspect", "open.obj", "--json").stdout)
    assert any("open" in each["what"] for each in report["findings"])


@pytest.mark.slow
def test_inspect_measures_what_was_done_to_the_surface(run, chair):
    chair.save("tall.obj", chair.vertices * [1, 2, 1])
    result = run("inspect", "MESH", "--against", "tall.obj", "--picture", "areas.png", "--json")
    assert worked(result)
    measured = json.loads(result.stdout)["against"]
    assert measured["volume"] == pytest.approx(1, abs=1e-4)
    assert 0.3 < measured["area"] < 1
    assert measured["flipped_faces"] == 0
    assert drawn("areas.png").std() > 10
    assert "volume +100.0%" in run("inspect", "MESH", "--against", "tall.obj").stdout


def test_inspect_refuses_what_it_cannot_compare_or_draw(run):
    Mesh(CORNERS, CUBE).save("cube.obj")
    assert failed(run("inspect", "MESH", "--against", "cube.obj"), "`--against` must have the faces of MESH")
    assert failed(run("inspect", "MESH", "--picture", "out.png"), "`--field` or `--against` must be given")
    assert failed(run("inspect", "MESH", "--field", "FIELD", "--picture", "out.jpg"), "`--picture` must end in .png")
