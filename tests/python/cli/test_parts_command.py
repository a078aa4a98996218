"""Test `dfd parts`, and parts as places in other commands."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_runs import drawn, failed, worked

import dfd


def test_parts_are_written_drawn_and_listed(run, chair):
    done = run("parts", "MESH", "--field", "FIELD", "-o", "parts.json", "--picture", "parts.png", "--resolution", 64)
    assert worked(done)
    found = json.loads(Path("parts.json").read_text())
    assert len(found["part_of_vertex"]) == len(chair.vertices)
    assert sorted(set(found["part_of_vertex"])) == [row["part"] for row in found["parts"]]
    assert sum(row["share"] for row in found["parts"]) == pytest.approx(1, abs=0.01)
    for row in found["parts"]:
        assert found["part_of_vertex"][row["vertex"]] == row["part"]
        assert f"at vertex {row['vertex']}" in done.stdout
    assert worked(run("parts", "MESH", "--field", "FIELD", "-o", "output.png", "--resolution", 64))
    np.testing.assert_array_equal(drawn("output.png"), drawn("parts.png"))


def test_a_handle_and_what_is_fixed_may_be_the_part_that_a_place_is_on(run, chair, folder):
    low = int(chair.vertices[:, 1].argmin())
    move = ("--translate", 0, 0.2, 0, "--reach", 1e-6, "-o", "out.ply")
    assert worked(run("deform", "MESH", "--field", "FIELD", "--handle", f"part@{low}", *move))
    session = dfd.Deformer(chair, dfd.Field.load(folder / "chair.field.safetensors"))
    moved = np.abs(dfd.load("out.ply").vertices - chair.vertices).max(axis=1) > 0.1
    assert moved[session.part(low).indices].all()


def test_a_level_makes_the_part_of_a_handle_smaller(run, chair):
    moved = []
    for level in (0, -1):
        move = ("--level", level, "--translate", 0, 0.2, 0, "-o", "out.ply")
        assert worked(run("deform", "MESH", "--field", "FIELD", "--handle", "0,0.5,0", *move))
        moved.append(int((np.abs(dfd.load("out.ply").vertices - chair.vertices).max(axis=1) > 0.1).sum()))
    assert moved[1] < moved[0]
    refused = run("deform", "MESH", "--field", "FIELD", "--handle", 5, "--level", 0.5, "-o", "out.ply")
    assert failed(refused, "`--level` must be a whole number, got 0.5")


def test_parts_are_groups_of_an_obj_and_material_slots_of_a_glb(run, chair):
    assert worked(run("parts", "MESH", "--field", "FIELD", "-o", "parts.json"))
    cut = json.loads(Path("parts.json").read_text())
    names = [f"part_{row['part']}" for row in cut["parts"]]
    for ending in ("obj", "glb"):
        assert worked(run("parts", "MESH", "--field", "FIELD", "-o", f"parts.{ending}"))
        again = dfd.load(f"parts.{ending}")
        assert len(again.faces) == len(chair.faces)
        np.testing.assert_allclose(again.bounds, chair.bounds, atol=1e-6)
    lines = Path("parts.obj").read_text().splitlines()
    assert [line[2:] for line in lines if line.startswith("g ")] == names
    assert len([line for line in lines if line.startswith("f ")]) == len(chair.faces)
    materials = [material.name for material in dfd.load("parts.glb").appearance.materials]
    assert sorted(materials) == sorted(name.replace("_", " ") for name in names)
    assert failed(run("parts", "MESH", "--field", "FIELD", "-o", "parts.ply"), "`--output` must end in .json, .obj")
    assert failed(run("parts", "shape.txt"), "`MESH` must end in .obj, .ply")
    assert failed(run("parts", "none.obj"), "`MESH` none.obj could not be read")
    assert failed(run("parts", "MESH", "--field", "none.safetensors"), "`--field`: none.safetensors does not exist")
