"""The public reference's checkpoint: the same features as its own network, and nothing executed."""

from __future__ import annotations

import json
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from dfd import Field, Mesh
from dfd.field.architecture import Architecture

WIDTH, OUT = 16, 10
VERTICES = np.array([[1.0, 2, 3], [5, 2, 3], [1, 4, 3], [2, 3, 4]])


@pytest.fixture
def mesh() -> Mesh:
    return Mesh(VERTICES, [[0, 1, 2], [0, 1, 3]])


def twin(layers: int, plain_start: bool) -> nn.Sequential:
    """The reference's network; with `plain_start` its first linear map has neither ReLU nor LayerNorm after it."""
    torch.manual_seed(4)
    entries: list[nn.Module] = [nn.Linear(3, WIDTH)]
    if not plain_start:
        entries += [nn.ReLU(), nn.LayerNorm([WIDTH])]
    for _ in range(layers):
        entries += [nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.LayerNorm([WIDTH])]
    network = nn.Sequential(*entries, nn.Linear(WIDTH, OUT))
    with torch.no_grad():  # LayerNorms that do something
        for parameter in network.parameters():
            parameter.add_(torch.randn_like(parameter) * 0.2)
    return network


def state_of(network: nn.Sequential) -> dict[str, torch.Tensor]:
    return {f"mlp.{name}": tensor.detach().clone() for name, tensor in network.state_dict().items()}


def write(folder: Path, state: Any, **config: Any) -> Path:
    path = folder / "final_encoder.pth"
    torch.save(state, path)
    settings = {"nlayers": 2, "width": WIDTH, "out_dim": OUT, "positional_encoding": False, "sigma": 5.0, **config}
    path.with_suffix(".json").write_text(json.dumps(settings))
    return path


@pytest.mark.parametrize(("plain_start", "layers"), [(True, 2), (False, 3)])
def test_features_are_those_of_the_network(mesh: Mesh, tmp_path: Path, plain_start: bool, layers: int) -> None:
    network = twin(2, plain_start)
    path = write(tmp_path, state_of(network), model="dino2", savedir="/x", description=[])
    field = Field.load(path, mesh=mesh)
    assert field.architecture == Architecture(OUT, WIDTH, layers)
    points = np.random.default_rng(0).uniform(-3, 6, (200, 3))
    # The middle of the box to the origin, its longest side, 4 units here, to [-1, 1].
    normalized = torch.from_numpy((points - [3, 3, 3.5]) / 2).float()
    with torch.inference_mode():
        wanted = nn.functional.normalize(network(normalized), dim=1)
    np.testing.assert_allclose(field(points), wanted.numpy(), atol=1e-5)
    assert field.settings["encoder"] == "dino2"
    assert field.settings["reference_sigma"] == 5.0


def test_it_is_a_field_like_any_other(mesh: Mesh, tmp_path: Path) -> None:
    path = write(tmp_path, state_of(twin(2, True)))
    state = torch.random.get_rng_state()
    field = Field.load(path, mesh=mesh)
    assert torch.equal(torch.random.get_rng_state(), state)
    field.save(tmp_path / "own.safetensors")
    again = Field.load(tmp_path / "own.safetensors")
    np.testing.assert_array_equal(again.features(mesh), field.features(mesh))
    assert again.settings == field.settings


class Trap:
    """Makes a folder when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return (Path.mkdir, (self.path,))


def test_nothing_in_the_file_is_executed(mesh: Mesh, tmp_path: Path) -> None:
    sprung = tmp_path / "sprung"
    path = write(tmp_path, {**state_of(twin(2, True)), "more": Trap(sprung)})
    with pytest.raises(ValueError, match="holds more than tensors, or no tensors, and is not opened"):
        Field.load(path, mesh=mesh)
    path.write_bytes(pickle.dumps(Trap(sprung)))  # not even an archive
    with pytest.raises(ValueError, match="Field.load: `path` .*final_encoder.pth: it"):
        Field.load(path, mesh=mesh)
    assert not sprung.exists()


def without(name: str) -> Any:
    return lambda state: {key: value for key, value in state.items() if key != name}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without("mlp.3.bias"), "mlp.3 must have a weight and a bias, found only a weight"),
        (lambda state: {**state, "head.weight": torch.zeros(1)}, "must hold mlp.N.weight and mlp.N.bias, found head"),
        (lambda state: {**state, "mlp.1.weight": torch.zeros(WIDTH, 7)}, r"linear maps must be .*found .*\(16, 7\)"),
        (lambda state: {**state, "mlp.0.weight": torch.zeros(WIDTH, 35)}, r"linear maps must be .*found \[\(16, 35\)"),
        (lambda state: {**state, "mlp.1.bias": torch.zeros(3)}, r"mlp.1 has a weight \(16, 16\) and a bias \(3,\)"),
        (lambda state: {**state, "mlp.3.weight": torch.full((WIDTH,), torch.nan)}, "mlp.3 holds numbers that are not"),
        (lambda state: {key: value for key, value in state.items() if "mlp.6" not in key}, "with a ReLU and a LayerN"),
        (lambda state: {**state, "mlp.1.weight": torch.zeros(WIDTH, WIDTH, dtype=torch.int64)}, "named tensors of flo"),
        (lambda state: [state], "must hold named tensors, got list"),
        (lambda state: {}, "must hold named tensors, got dict"),
    ],
)
def test_other_networks_are_refused(mesh: Mesh, tmp_path: Path, change: Any, message: str) -> None:
    path = write(tmp_path, change(state_of(twin(2, True))))
    with pytest.raises(ValueError, match=message):
        Field.load(path, mesh=mesh)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"positional_encoding": True}, "is a network with positional encoding"),
        ({"normalizemlp": False}, "features are not of unit length"),
        ({"width": 32}, "its .json says width 32, its tensors say 16"),
        ({"out_dim": 384}, "its .json says out_dim 384, its tensors say 10"),
    ],
)
def test_other_settings_are_refused(mesh: Mesh, tmp_path: Path, config: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Field.load(write(tmp_path, state_of(twin(2, True)), **config), mesh=mesh)


def test_damaged_and_missing_files_are_named(mesh: Mesh, tmp_path: Path) -> None:
    path = write(tmp_path, state_of(twin(2, True)))
    with pytest.raises(ValueError, match="Field.load: `mesh` must be given for .*final_encoder.pth"):
        Field.load(path)
    whole = path.read_bytes()
    for content in (b"", whole[: len(whole) // 2], b"PK\x03\x04" + bytes(100), b"hello"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="final_encoder.pth: it"):
            Field.load(path, mesh=mesh)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("note.txt", "no network")
    with pytest.raises(ValueError, match="final_encoder.pth: it"):
        Field.load(path, mesh=mesh)
    path.write_bytes(whole)
    settings = path.with_suffix(".json")
    for text, message in (("{", "final_encoder.json is not JSON"), ("[1]", "must hold a JSON object, got list")):
        settings.write_text(text)
        with pytest.raises(ValueError, match=message):
            Field.load(path, mesh=mesh)
    settings.unlink()
    with pytest.raises(FileNotFoundError, match="final_encoder.json, which belongs to the .pth file, does not exist"):
        Field.load(path, mesh=mesh)
    with pytest.raises(FileNotFoundError, match="does not exist"):
        Field.load(tmp_path / "none.pth", mesh=mesh)
