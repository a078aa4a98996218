"""Recipes: equal by content, and of the code that makes fields and no other."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import dfd
from dfd import Mesh
from dfd.runs.known_meshes import MESH_ROOMS
from dfd.runs.recipe import FIELD_ROOMS, difference, hash_arrays, hash_code, hash_recipe, recipe


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the package's own modules."""
    return Path(
        shutil.copytree(Path(dfd.__file__).parent, tmp_path / "dfd", ignore=shutil.ignore_patterns("*.so", "*.pyc"))
    )


def test_recipes_are_equal_by_content() -> None:
    mesh = dfd.samples.chair(4000).mesh
    one = recipe(mesh, views=24, rate=0.5, faces=None)
    two = recipe(mesh, faces=None, rate=np.float64(0.5), views=np.int64(24))
    assert one == two
    assert hash_recipe(one) == hash_recipe(two)
    assert hash_recipe(recipe(mesh, views=25)) != hash_recipe(recipe(mesh, views="25"))
    other = recipe(Mesh(mesh.vertices * 2, mesh.faces), views=25, rate=0.5)
    assert difference(one, other) == "another mesh; views 24, now 25"


@pytest.mark.parametrize(
    "module",
    ["distillation/fit.py", "encoders/offline.py", "views/cameras.py", "mesh/weld.py", "common/pca.py", "field/new.py"],
)
def test_an_edit_of_what_makes_fields_is_another_recipe(package: Path, module: str) -> None:
    before = hash_code.__wrapped__(FIELD_ROOMS, package)
    assert before == hash_code(FIELD_ROOMS)
    with (package / module).open("a") as stream:
        stream.write("# an edit\n")
    assert hash_code.__wrapped__(FIELD_ROOMS, package) != before


@pytest.mark.parametrize("module", ["cli/distill.py", "editing/deformer.py", "demo.py", "cli/new.py"])
def test_an_edit_of_anything_else_is_none(package: Path, module: str) -> None:
    before = hash_code.__wrapped__(FIELD_ROOMS, package)
    with (package / module).open("a") as stream:
        stream.write("# an edit\n")
    assert hash_code.__wrapped__(FIELD_ROOMS, package) == before


def test_another_version_is_another_recipe(monkeypatch: pytest.MonkeyPatch) -> None:
    before = hash_code.__wrapped__(FIELD_ROOMS)
    monkeypatch.setattr("dfd.runs.recipe._version", lambda package: "0")
    assert hash_code.__wrapped__(FIELD_ROOMS) != before


def test_every_room_is_there() -> None:
    for room in (*FIELD_ROOMS, *MESH_ROOMS):
        assert (Path(dfd.__file__).parent / room / "__init__.py").is_file()


def test_the_rooms_of_fields_import_no_others() -> None:
    root = Path(dfd.__file__).parent
    for room in FIELD_ROOMS:
        for path in (root / room).rglob("*.py"):
            for line in path.read_text("utf-8").splitlines():
                words = line.split()
                if len(words) > 1 and words[0] in ("from", "import") and words[1].startswith("dfd."):
                    assert words[1].split(".")[1] in FIELD_ROOMS, f"{path}: {line}"


def test_arrays_are_told_apart_by_type_shape_and_content() -> None:
    hashes = {
        hash_arrays(np.zeros(4, np.float32)),
        hash_arrays(np.zeros(2, np.float64)),
        hash_arrays(np.zeros((2, 2), np.float32)),
        hash_arrays(np.ones(4, np.float32)),
        hash_arrays(np.zeros(2, np.float32), np.zeros(2, np.float32)),
    }
    assert len(hashes) == 5
    rows = np.arange(6.0).reshape(2, 3)
    assert hash_arrays(rows.T) == hash_arrays(np.ascontiguousarray(rows.T))
