"""Test fields: features of unit length, mesh units, gradients, and files."""

import json
import subprocess
import sys

import numpy as np
import pytest
import reference
import torch
from made_field import made_field
from safetensors import safe_open
from safetensors.numpy import save_file

from dfd import Field

NETWORK = {"dimension": 12, "width": 16, "layers": 2, "octaves": 2}


@pytest.fixture
def field():
    place = {"center": (1.0, 2.0, 3.0), "scale": 0.5}
    return made_field(**NETWORK, **place, settings={"encoder": "test", "views": 3})


def points(count=100):
    return np.random.default_rng(0).normal(size=(count, 3)) * 3


def test_array_and_tensor_agree_and_only_tensors_carry_gradients(field):
    tensor = torch.from_numpy(points()).requires_grad_()
    features = field(tensor)
    np.testing.assert_allclose(features.detach().numpy(), field(points()), atol=1e-6)
    features[:, 0].sum().backward()
    assert tensor.grad.abs().sum() > 0


def test_center_and_scale_undo_the_units_of_the_mesh(field):
    far = Field(field.parameters, octaves=2, center=(1e7, 2e7, -1e7), scale=1e-3)
    normalized = points()
    np.testing.assert_allclose(
        far(normalized * 1e3 + np.array([1e7, 2e7, -1e7])), field(normalized * 2 + np.array([1, 2, 3])), atol=1e-5
    )


@pytest.mark.parametrize("octaves", [0, 1, 5, 16])
@pytest.mark.parametrize(("dimension", "width", "layers"), [(1, 1, 1), (3, 7, 2), (384, 256, 4), (33, 50, 3)])
def test_features_equal_those_of_the_slow_reference(octaves, dimension, width, layers):
    field = made_field(dimension, width=width, layers=layers, octaves=octaves, center=(0.1, 0.2, -0.3), scale=0.7)
    some = points(101) / 3
    np.testing.assert_allclose(field(some), reference.field(field, some), atol=2e-5)


def test_a_field_is_used_without_torch(field, tmp_path):
    field.save(tmp_path / "a.safetensors")
    code = (
        "import sys, numpy as np, dfd\n"
        f"field = dfd.Field.load({str(tmp_path / 'a.safetensors')!r})\n"
        "vertices = np.random.default_rng(0).normal(size=(100, 3))\n"
        "mesh = dfd.Mesh(vertices, [[0, 1, 2]])\n"
        "session = dfd.Deformer(mesh, field, features=dfd.compact(field, vertices))\n"
        "session.add(3, translation=(0, 1, 0))\n"
        "assert (session.vertices != vertices).any()\n"
        "print(sorted({'torch', 'transformers'} & sys.modules.keys()))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_no_points_give_no_rows(field):
    assert field(np.zeros((0, 3))).shape == (0, 12)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.zeros((4, 2)), r"Field: `points` must have shape \(N, 3\), got \(4, 2\)"),
        (np.full((2, 3), np.nan), r"Field: `points` must be finite, got nan at \[0, 0\]"),
        (torch.ones(4, 3).to_sparse(), "^Field: `points` must be a dense tensor of real numbers"),
        (torch.zeros(3), r"Field: `points` must have shape \(N, 3\), got \(3,\)"),
        (np.full((2, 3), 1e308), "`points` must have coordinates within 1e.06 half sides"),
    ],
)
def test_bad_points_are_named(field, bad, message):
    with pytest.raises(ValueError, match=message):
        field(bad)


def test_points_are_accepted_up_to_a_million_half_sides_from_the_center_of_the_box():
    center = np.array([3e6, 0.0, 0.0])
    field = made_field(4, width=8, layers=1, center=center, scale=0.5)
    for direction in (-1.0, 1.0):
        near, far = (center + direction * factor * np.array([2e6, 0, 0]) for factor in (0.999, 1.001))
        assert np.isfinite(field([near])).all()
        with pytest.raises(ValueError, match="`points` must have coordinates within 1e.06 half sides"):
            field([far])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dimension": 0}, "`dimension` must be a whole number of at least 1, got 0"),
        ({"dimension": 3, "octaves": 17}, "`octaves` must be a whole number from 0 to 16, got 17"),
        ({"dimension": 3, "scale": 0.0}, "`scale` must be above 0, got 0"),
        ({"dimension": 3, "center": (0, 0)}, r"`center` must have shape \(3,\), got \(2,\)"),
    ],
)
def test_bad_construction_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        made_field(**arguments)


def test_wrong_parameters_are_named(field):
    with pytest.raises(ValueError, match="`parameters` must be those of a network, got none"):
        Field({})
    with pytest.raises(ValueError, match=r"must hold network.0.weight \(16, 3\), got network.0.weight \(16, 15\)"):
        Field(field.parameters)
    with pytest.raises(ValueError, match=r"`network.0.bias` must be finite"):
        Field({**field.parameters, "network.0.bias": np.full(16, np.nan)}, octaves=2)


def test_file_gives_the_field_back(field, tmp_path):
    path = tmp_path / "a.safetensors"
    field.save(path)
    loaded = Field.load(path)
    assert loaded.settings == {"encoder": "test", "views": 3}
    np.testing.assert_array_equal(loaded(points()), field(points()))
    assert list(tmp_path.iterdir()) == [path]
    content = path.read_bytes()
    for _ in range(5):  # equal fields give equal files
        loaded.save(path)
        assert path.read_bytes() == content


def test_a_small_field_far_from_the_origin_can_be_loaded(tmp_path):
    small = made_field(4, width=8, layers=1, center=(1e4, 0, 0), scale=1e7)
    small.save(tmp_path / "a.safetensors")
    loaded = Field.load(tmp_path / "a.safetensors")
    np.testing.assert_array_equal(loaded([small.center]), small([small.center]))


def test_arrays_of_a_field_are_its_own_and_read_only(field):
    given = {name: values.copy() for name, values in field.parameters.items()}
    center, surface = np.array([1.0, 2.0, 3.0]), np.zeros((512, 3), np.float32)
    made = Field(given, octaves=2, center=center, surface=surface)
    before = made(points())
    for array in (*given.values(), center, surface):
        array += 1
    np.testing.assert_array_equal(made(points()), before)
    for array in (*made.parameters.values(), made.center, made.surface):
        assert not array.flags.writeable
    with pytest.raises(ValueError, match=r"`surface` must have shape \(512, 3\), got \(5, 3\)"):
        Field(given, octaves=2, surface=surface[:5])


def test_without_a_box_a_field_is_that_of_the_cube_around_the_origin(field):
    plain = Field(field.parameters, octaves=2)
    boxed = Field(field.parameters, octaves=2, center=(0, 0, 0), scale=1.0)
    np.testing.assert_array_equal(plain(points()), boxed(points()))


def rewrite(field, path, metadata=None, tensors=None):
    field.save(path)
    with safe_open(path, framework="np") as file:
        old = {**file.metadata(), **(metadata or {})}
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # `file` is no mapping
    save_file({**arrays, **(tensors or {})}, path, old)


@pytest.mark.parametrize(
    ("metadata", "tensors", "message"),
    [
        ({"format": "other"}, {}, "is a safetensors file, but not a field"),
        ({"version": "99"}, {}, "must have version 1, got 99"),
        ({"network": "{"}, {}, "has an unreadable header"),
        (
            {},
            {"network.0.weight": np.zeros((16, 4), np.float32)},
            r"must hold network.0.weight \(16, 15\), got .*\(16, 4\)",
        ),
        ({}, {"network.0.bias": np.full(16, np.nan, np.float32)}, "is damaged: `network.0.bias` must be finite"),
        ({}, {"scale": np.array(-1.0)}, "is damaged: `scale` must be above 0, got -1"),
        ({"network": json.dumps({**NETWORK, "layers": 3})}, {}, "must be those of .*layers=3.*, got .*layers=2"),
        ({"network": json.dumps({**NETWORK, "layers": 10**9})}, {}, "must be those of .*layers=1000000000"),
        ({"settings": "[" * 10**5}, {}, "has an unreadable header"),
        ({}, {"network.0.weight": np.full((16, 15), 3e38, np.float32)}, "its features are not finite"),
        ({"network": json.dumps({**NETWORK, "octaves": 99})}, {}, "`octaves` must be .* 16, got 99"),
        ({"network": json.dumps({**NETWORK, "depth": 3})}, {}, "has an unreadable header: .*depth"),
    ],
)
def test_wrong_file_is_refused(field, tmp_path, metadata, tensors, message):
    path = tmp_path / "a.safetensors"
    rewrite(field, path, metadata, tensors)
    with pytest.raises(ValueError, match=message):
        Field.load(path)


def test_a_file_that_is_cut_short_is_refused_once(field, tmp_path):
    path = tmp_path / "a.safetensors"
    field.save(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match="is truncated or not a field: .*header length"):
        Field.load(path)
