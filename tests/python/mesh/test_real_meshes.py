"""Test that saved meshes load unchanged, with all meshes in the folder that `DFD_MESHES` names, if it is set."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from mesh_files import header_and_data

from dfd.mesh.mesh import load

FOLDER = os.environ.get("DFD_MESHES")
FILES = sorted(Path(FOLDER).rglob("*.obj")) + sorted(Path(FOLDER).rglob("*.glb")) if FOLDER else []


def load_quietly(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of OBJ files without their MTL files
        return load(path)


@pytest.mark.skipif(not FILES, reason="DFD_MESHES names no folder of meshes")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_saved_mesh_loads_unchanged(path, tmp_path):
    mesh = load_quietly(path)
    moved = mesh.vertices * [1.1, 0.9, 1.0] + 0.3 * mesh.diagonal
    for ending in (".glb", ".obj", ".ply"):
        mesh.save(tmp_path / f"{path.stem}{ending}", moved)
        again = load_quietly(tmp_path / f"{path.stem}{ending}")
        assert again.faces.shape == mesh.faces.shape
        assert np.allclose(again.vertices[again.faces], moved[mesh.faces], rtol=0, atol=1e-5 * mesh.diagonal)
        if ending == path.suffix:
            assert again.part_names == mesh.part_names
    if path.suffix == ".glb":
        before, after = header_and_data(path)[0], header_and_data(tmp_path / f"{path.stem}.glb")[0]
        for name in ("skins", "animations", "materials", "textures", "samplers", "scenes", "cameras"):
            assert after.get(name) == before.get(name)
    else:
        assert np.array_equal(load_quietly(tmp_path / f"{path.stem}.obj").vertices, moved[mesh.representative])
