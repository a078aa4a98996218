"""A chair, a field that has learnt nothing, and a folder to run commands in."""

import pytest
import torch
from made_field import made_field
from typer.testing import CliRunner

import dfd
from dfd.cli import app


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with chair.obj and chair.field.safetensors, a field that has learnt nothing."""
    path = tmp_path_factory.mktemp("cli")
    mesh = dfd.samples.chair(4000).mesh
    mesh.save(path / "chair.obj")
    with torch.random.fork_rng():
        torch.manual_seed(1)
        field = made_field(16, width=32, layers=2, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents))
    field.settings = {"encoder": "none", "seed": 3, "losses": [1.0, 0.5, 0.4]}
    field.save(path / "chair.field.safetensors")
    return path


@pytest.fixture
def chair(folder):
    return dfd.load(folder / "chair.obj")


@pytest.fixture
def run(folder, tmp_path, monkeypatch):
    """Run dfd in an empty folder with an empty cache; MESH and FIELD stand for the chair's files."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    names = {"MESH": str(folder / "chair.obj"), "FIELD": str(folder / "chair.field.safetensors")}

    def invoke(*arguments):
        return CliRunner().invoke(app, [names.get(argument, str(argument)) for argument in arguments], prog_name="dfd")

    return invoke
