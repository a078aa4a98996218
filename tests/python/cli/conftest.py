"""A chair, an untrained field, and a function that runs commands."""

import pytest
from made_field import field_of
from typer.testing import CliRunner

import dfd
from dfd.cli import app


@pytest.fixture(scope="module")
def folder(tmp_path_factory, chair_mesh):
    """A folder with chair.obj and chair.field.safetensors, an untrained field."""
    path = tmp_path_factory.mktemp("cli")
    chair_mesh.save(path / "chair.obj")
    field = field_of(chair_mesh)
    field.settings = {"encoder": "none", "seed": 3, "losses": [1.0, 0.5, 0.4]}
    field.save(path / "chair.field.safetensors")
    return path


@pytest.fixture
def chair(folder):
    return dfd.load(folder / "chair.obj")


@pytest.fixture
def run(folder, tmp_path, monkeypatch):
    """Return a function that runs `dfd` in an empty folder; MESH and FIELD stand for the chair's files."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    names = {"MESH": str(folder / "chair.obj"), "FIELD": str(folder / "chair.field.safetensors")}

    def invoke(*arguments):
        return CliRunner().invoke(app, [names.get(argument, str(argument)) for argument in arguments], prog_name="dfd")

    return invoke
