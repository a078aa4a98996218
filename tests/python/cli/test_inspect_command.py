"""`dfd inspect`."""

import json
import re
import sys
from unittest import mock

import numpy as np
import pytest
from command_runs import drawn, failed, worked
from mesh_files import CORNERS, CUBE

from dfd import Mesh

DISTILL = sys.modules["dfd.cli.distill"]  # by its own name there is the command


def test_inspect_prints_a_table(run):
    result = run("inspect", "MESH")
    assert worked(result)
    assert result.stderr == ""
    lines = [line.split() for line in result.stdout.splitlines()]
    assert ["vertex", "count", "2,004"] in lines
    assert ["face", "count", "4,008"] in lines
    assert ["boundary", "edges", "0"] in lines
    assert ["unseen", "nothing,", "in", "24", "views"] in lines
    assert "symmetry" not in result.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vertices", "faces", "line"),
    [
        (
            np.vstack([CORNERS, CORNERS / 2 + 0.25]),
            np.vstack([CUBE, CUBE + 8]),
            "unseen 20.0% of the surface, 1 of 2 components wholly, in 24 views: it takes the nearest seen features",
        ),
        (
            np.vstack([CORNERS, CORNERS + [0, 0, 1]]),
            np.vstack([CUBE, CUBE + 8]),
            "unseen 16.7% of the surface, in 24 views: it takes the nearest seen features",
        ),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "unseen all of it, for no face has an area"),
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
    assert "16 dimensions" in table.stdout


def test_inspect_says_when_there_is_no_plane(run):
    with mock.patch("dfd.symmetry.search.RELATIVE_THRESHOLD", 0.0), mock.patch("dfd.symmetry_planes", return_value=[]):
        result = run("inspect", "MESH", "--field", "FIELD")
    assert ["symmetry", "planes", "none"] in [line.split() for line in result.stdout.splitlines()]


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
    assert f"1: vertex {first['vertex']}, {first['share']:.0%} of the shape" in table.stdout


def test_inspect_says_what_is_odd(run):
    Mesh(CORNERS, CUBE[:-1]).save("open.obj")
    result = run("inspect", "open.obj")
    assert worked(result)
    text = " ".join(result.stdout.split())
    assert "odd The surface is open: 3 edges have one face only." in text
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
    table = run("inspect", "MESH", "--against", "tall.obj")
    assert ["volume", "+100.0%"] in [line.split() for line in table.stdout.splitlines()]


def test_inspect_refuses_what_it_cannot_compare_or_draw(run):
    Mesh(CORNERS, CUBE).save("cube.obj")
    assert failed(run("inspect", "MESH", "--against", "cube.obj"), "`--against` must have the faces of MESH")
    assert failed(run("inspect", "MESH", "--picture", "out.png"), "`--field` or `--against` must be given")
    assert failed(run("inspect", "MESH", "--field", "FIELD", "--picture", "out.jpg"), "`--picture` must end in .png")


def test_inspect_draws_the_parts_with_a_row_each(run):
    result = run("inspect", "MESH", "--field", "FIELD", "--up", "file", "--parts", "--picture", "parts.png")
    assert worked(result)
    rows = [line.split() for line in result.stdout.splitlines() if re.match(r"part \d", line)]
    assert [row[1] for row in rows] == [str(number) for number in range(1, len(rows) + 1)]
    assert len(rows) >= 1
    assert drawn("parts.png").std() > 10
    cut = json.loads(run("inspect", "MESH", "--field", "FIELD", "--up", "file", "--parts", "--json").stdout)["cut"]
    assert len(cut["parts"]) == len(rows)
    assert failed(run("inspect", "MESH", "--parts"), "`--field` must be given: `--parts` are told apart by")
