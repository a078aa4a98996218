"""The field: unit rows at any point, the mesh's units inside, and a file that is whole or refused."""

from __future__ import annotations

import errno
import json
import resource
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from dfd import Field

NETWORK = {"dimension": 12, "width": 16, "layers": 2, "octaves": 2}


@pytest.fixture
def field() -> Field:
    torch.manual_seed(1)
    place = {"center": (1.0, 2.0, 3.0), "scale": 0.5}
    return Field(**NETWORK, **place, settings={"encoder": "test", "views": 3})


def points(count: int = 100) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(count, 3)) * 3


def test_rows_are_unit_float32(field: Field) -> None:
    features = field(points())
    assert features.shape == (100, 12)
    assert features.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, atol=1e-6)


def test_array_and_tensor_agree_and_only_tensors_carry_gradients(field: Field) -> None:
    tensor = torch.from_numpy(points()).requires_grad_()
    features = field(tensor)
    np.testing.assert_allclose(features.detach().numpy(), field(points()), atol=1e-6)
    features[:, 0].sum().backward()
    assert tensor.grad is not None
    assert tensor.grad.abs().sum() > 0


def test_center_and_scale_undo_the_units_of_the_mesh(field: Field) -> None:
    far = Field(**NETWORK, center=(1e7, 2e7, -1e7), scale=1e-3)
    far.network.load_state_dict(field.network.state_dict())
    normalized = points()
    np.testing.assert_allclose(
        far(normalized * 1e3 + np.array([1e7, 2e7, -1e7])), field(normalized * 2 + np.array([1, 2, 3])), atol=1e-5
    )


def test_sines_are_of_the_normalised_coordinates() -> None:
    plain, waved = Field(3, width=4, layers=1), Field(3, width=4, layers=1, octaves=2, center=(1, 0, 0), scale=2.0)
    with torch.no_grad():  # the first layer passes on one sine: of x, at half of the longest wavelength
        for network in (plain.network, waved.network):
            network[0].weight.zero_()
            network[0].bias.fill_(1.0)
            network[3].weight.copy_(torch.eye(3, 4))
            network[3].bias.zero_()
        waved.network[0].weight[0, 3 + 6] = 1.0
        plain.network[0].weight[0, 0] = 1.0
    x = np.linspace(0.55, 0.95, 9)
    normalized = (x - 1) * 2
    at = np.column_stack([x, x * 0, x * 0])
    np.testing.assert_allclose(waved(at), plain(np.column_stack([np.sin(np.pi * normalized), at[:, 1:]])), atol=1e-6)


def test_a_field_from_before_the_sines_is_read(field: Field, tmp_path: Path) -> None:
    plain = Field(12, width=16, layers=2)
    plain.save(tmp_path / "a.safetensors")
    network = {"dimension": 12, "width": 16, "layers": 2}
    rewrite(plain, tmp_path / "a.safetensors", {"network": json.dumps(network)}, {})
    np.testing.assert_array_equal(Field.load(tmp_path / "a.safetensors")(points()), plain(points()))


def test_many_points_equal_few(field: Field) -> None:
    many = points(20_001)
    np.testing.assert_allclose(field(many)[::1000], field(many[::1000]), atol=1e-6)


def test_no_points_give_no_rows(field: Field) -> None:
    assert field(np.zeros((0, 3))).shape == (0, 12)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.zeros((4, 2)), r"Field: `points` must have shape \(N, 3\), got \(4, 2\)"),
        (np.full((2, 3), np.nan), r"Field: `points` must be finite, got nan at \[0, 0\]"),
        ("somewhere", "Field: `points` must be a numeric array, got str"),
        (torch.zeros(3), r"Field: `points` must have shape \(N, 3\), got \(3,\)"),
    ],
)
def test_bad_points_are_named(field: Field, bad: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        field(bad)  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dimension": 0}, "`dimension` must be a whole number of at least 1, got 0"),
        ({"dimension": 3, "width": 2.5}, "`width` must be a whole number, got 2.5"),
        ({"dimension": 3, "scale": 0.0}, "`scale` must be above 0, got 0"),
        ({"dimension": 3, "center": (0, 0)}, r"`center` must have shape \(3,\), got \(2,\)"),
    ],
)
def test_bad_construction_is_named(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Field(**arguments)


def test_file_gives_the_field_back(field: Field, tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    field.save(path)
    state = torch.random.get_rng_state()
    loaded = Field.load(path)
    assert torch.equal(torch.random.get_rng_state(), state)
    assert loaded.settings == {"encoder": "test", "views": 3}
    np.testing.assert_array_equal(loaded(points()), field(points()))
    assert list(tmp_path.iterdir()) == [path]


def test_cut_file_is_refused(field: Field, tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    field.save(path)
    whole = path.read_bytes()
    for length in (0, 4, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="cut short or no field"):
            Field.load(path)


def rewrite(field: Field, path: Path, metadata: dict | None = None, tensors: dict | None = None) -> None:
    field.save(path)
    with safe_open(path, framework="pt") as file:
        old = {**file.metadata(), **(metadata or {})}
    save_file({**field.state_dict(), **(tensors or {})}, path, old)


@pytest.mark.parametrize(
    ("metadata", "tensors", "message"),
    [
        ({"format": "other"}, {}, "is a safetensors file but no field"),
        ({"version": "99"}, {}, "has version 99, this dfd reads 1"),
        ({"network": "{"}, {}, "has an unreadable header"),
        ({}, {"network.0.weight": torch.zeros(16, 4)}, r"must hold network.0.weight \(16, 15\), found .*\(16, 4\)"),
        ({}, {"network.0.bias": torch.full((16,), torch.nan)}, "not finite in network.0.bias"),
        ({}, {"extra": torch.zeros(1)}, "unknown tensor extra"),
        ({}, {"scale": torch.tensor(-1.0, dtype=torch.float64)}, "has scale -1.0, not above 0"),
        ({"network": json.dumps({**NETWORK, "layers": 3})}, {}, "must hold network.6.weight"),
        ({"network": json.dumps({**NETWORK, "octaves": 99})}, {}, "`octaves` must be .* 16, got 99"),
        ({"network": json.dumps({**NETWORK, "depth": 3})}, {}, "has an unreadable header: .*depth"),
        ({"network": json.dumps({**NETWORK, "width": 10**9})}, {}, "must hold network.0.weight"),
        ({"network": "[3]"}, {}, "has an unreadable header"),
    ],
)
def test_wrong_file_is_refused(field: Field, tmp_path: Path, metadata: dict, tensors: dict, message: str) -> None:
    path = tmp_path / "a.safetensors"
    rewrite(field, path, metadata, tensors)
    with pytest.raises(ValueError, match=message):
        Field.load(path)


def test_missing_and_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="does not exist"):
        Field.load(tmp_path / "none.safetensors")
    (tmp_path / "text").write_text("hello, I am no field at all")
    with pytest.raises(ValueError, match="cut short or no field"):
        Field.load(tmp_path / "text")


def test_a_save_that_fails_leaves_the_old_file(field: Field, tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    field.save(path)
    before = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # a disk with 1000 bytes left
    try:
        with pytest.raises(OSError, match="a.safetensors could not be written"):
            field.save(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(OSError, match="the folder .* does not exist") as error:
        field.save(tmp_path / "nowhere" / "a.safetensors")
    assert error.value.errno in (None, errno.ENOENT)


def test_equal_fields_are_equal_files(tmp_path: Path) -> None:
    settings = {"views": 24, "encoder": "dinov2-small", "losses": [0.5, 0.25]}
    contents = set()
    for number in range(20):
        Field.seeded(1, 4, width=8, layers=1, settings=settings).save(tmp_path / f"{number}.safetensors")
        contents.add((tmp_path / f"{number}.safetensors").read_bytes())
    assert len(contents) == 1
    with safe_open(tmp_path / "0.safetensors", framework="np") as file:  # as other programs read it
        assert file.metadata()["format"] == "dfd-field"
        assert file.get_tensor("center").shape == (3,)


def test_a_file_with_its_metadata_in_another_order_is_read(tmp_path: Path) -> None:
    field = Field.seeded(1, 4, width=8, layers=1, settings={"seed": 1})
    field.save(tmp_path / "now.safetensors")
    with safe_open(tmp_path / "now.safetensors", framework="pt") as file:
        metadata, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    save_file(tensors, tmp_path / "before.safetensors", dict(reversed(metadata.items())))
    before = Field.load(tmp_path / "before.safetensors")
    assert before.settings == field.settings
    assert all(torch.equal(value, field.state_dict()[name]) for name, value in before.state_dict().items())
