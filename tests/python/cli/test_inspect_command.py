"""Test `dfd inspect`."""

import json
from unittest import mock

import pytest
from command_runs import worked
from mesh_files import CORNERS, CUBE

from dfd import Mesh


def test_inspect_prints_four_lines(run, folder):
    result = run("inspect", "MESH", "--field", "FIELD")
    assert worked(result)
    assert result.stderr == ""
    mesh, up, field, planes = result.stdout.splitlines()
    assert mesh.endswith("chair.obj: 2,004 vertices, 4,008 faces, 1 component, closed, 0.500684 × 0.989675 × 0.535896")
    assert up.startswith("up: +y")
    assert field == f"field: {folder / 'chair.field.safetensors'}, 16 dimensions, none"
    assert planes.startswith("symmetry planes: ")
    assert len(run("inspect", "MESH").stdout.splitlines()) == 2


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
    assert [1, 0, 0] in [plane["normal"] for plane in report["symmetry_planes"]]
    assert worked(table)
    assert "x=0 (score" in table.stdout


def test_inspect_says_what_is_odd(run):
    Mesh(CORNERS, CUBE[:-1]).save("open.obj")
    result = run("inspect", "open.obj")
    assert worked(result)
    text = " ".join(result.stdout.split())
    assert "odd: The surface is open: 3 edges have one face only." in text
    report = json.loads(run("inspect", "open.obj", "--json").stdout)
    assert any("open" in each["what"] for each in report["findings"])
