"""Test the modules of the Blender extension that need no Blender. `make test-blender` tests all of them inside it."""

import importlib.util
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

import dfd
from dfd.common.distribution import DISTRIBUTION
from dfd.field.architecture import Architecture
from dfd.posing.transforms import Transform

FOLDER = Path(__file__).resolve().parents[2] / "python" / "blender"


def part(name):
    spec = importlib.util.spec_from_file_location(f"blender_{name}", FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def shape():
    """Return a chair beside the origin, so that every rotation moves its bounding box."""
    mesh = dfd.samples.chair(4000).mesh
    return dfd.Mesh(mesh.vertices + [0, 1, 0], mesh.faces)


@pytest.fixture
def field_file(shape, tmp_path):
    random = np.random.default_rng(0)
    parameters = {
        name: (random.standard_normal(size) / np.sqrt(size[-1])).astype(np.float32)
        for name, size in Architecture(8, 32, 2, 4).shapes().items()
    }
    low, high = shape.bounds
    path = tmp_path / "chair.field.safetensors"
    dfd.Field(parameters, octaves=4, center=(low + high) / 2, scale=2 / (high - low).max()).save(path)
    return path


def in_blender(vertices):
    """Return vertices (V, 3) after the rotation of Blender's glTF importer, from y up to z up."""
    return np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1)


@pytest.mark.parametrize("turned", [False, True])
def test_weights_are_those_of_a_session_however_the_file_was_turned(shape, field_file, turned):
    vertices = in_blender(shape.vertices) if turned else shape.vertices
    found = part("shapes").Shape(vertices, shape.faces, field_file, "AUTO")
    assert found.axes == ("Y_UP" if turned else "SAME")
    controls = {"reach": 0.7, "falloff": "sharp", "locality": 2.0, "strength": 0.8, "mask": "y>1", "mask_feather": 0.1}
    for given in ({}, {"reach": "part"}, {"radius": 0.5}, controls):
        session = dfd.Deformer(shape, dfd.Field.load(field_file), preset="paper")
        session.add(5, **given)
        np.testing.assert_allclose(found.weights(5, "paper", **given), session.weights[:, 0], atol=1e-5)


@pytest.mark.parametrize("turned", [False, True])
def test_an_edit_file_poses_as_in_a_session(shape, field_file, tmp_path, turned):
    session = dfd.Deformer(shape, dfd.Field.load(field_file))
    leg = session.add(5, reach=0.6, translation=(0, -0.2, 0.1), name="leg")
    session.add(shape.vertices[900], reach=0.5, rotation=(0, 30, 0))
    session.fix(int(shape.vertices[:, 1].argmax()), strength=0.5)
    session.set_poses([dfd.KeyPose(1, {leg: Transform(translation=(0.3, 0, 0))}, "out")])
    session.save(tmp_path / "edit.json")
    to = in_blender if turned else np.asarray
    found = part("shapes").Shape(to(shape.vertices), shape.faces, field_file, "AUTO")
    edit, document = found.read(tmp_path / "edit.json")
    applied = found.applied(edit)
    np.testing.assert_allclose(applied.vertices, to(session.vertices), atol=1e-6)
    np.testing.assert_allclose(applied.weights[leg], session.weights[:, 0], atol=1e-6)
    (seconds, name, posed) = applied.poses[0]
    session.move(leg, translation=(0.3, 0, 0))
    session.move(session.handles[1].id, rotation=(0, 0, 0))
    assert (seconds, name) == (1, "out")
    np.testing.assert_allclose(posed, to(session.vertices), atol=1e-6)
    changed = found.edit(document, {leg: {"reach": 0.3}}, "paper")
    assert [handle.id for handle in changed.handles] == [leg]
    assert (changed.handle(leg).controls.reach, changed.preset) == (0.3, "paper")
    assert changed.handle(leg).transform == edit.handle(leg).transform
    assert len(changed.fixed) == 1


def test_weights_in_blender_need_neither_torch_nor_pydantic():
    left_out = ("torch", "pydantic", "rich", "typer", "mapbox_earcut", "fast_simplification", "embreex")
    code = "import runpy, sys; runpy.run_path(sys.argv[1]); print(sys.modules.keys() & set(sys.argv[2:]))"
    command = [sys.executable, "-c", code, str(FOLDER / "shapes.py"), *left_out]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "set()\n"


def test_a_field_of_another_shape_is_refused(shape, field_file):
    with pytest.raises(ValueError, match="`field` must belong to this mesh"):
        part("shapes").Shape(10 * shape.vertices, shape.faces, field_file, "AUTO")


def test_the_manifest_names_the_wheels_beside_it():
    build = part("build")
    try:
        import tomllib
    except ImportError:
        pytest.skip("tomllib comes with Python 3.11")
    manifest = tomllib.loads(build.with_wheels(["a-1-py3-none-any.whl", "b-2-py3-none-any.whl"]))
    assert manifest["wheels"] == ["./wheels/a-1-py3-none-any.whl", "./wheels/b-2-py3-none-any.whl"]
    assert manifest["permissions"]
    assert manifest["version"] == version(DISTRIBUTION)


def test_building_without_a_wheel_says_what_makes_one(tmp_path):
    with pytest.raises(FileNotFoundError, match="make wheel"):
        part("build").main(tmp_path)


def test_the_parts_of_a_shape_hold_every_vertex_once(shape, field_file):
    parts = part("shapes").Shape(shape.vertices, shape.faces, field_file, "AUTO").parts()
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(len(shape.vertices)))
