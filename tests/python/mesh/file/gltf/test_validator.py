"""The Khronos validator never finds an error in a saved glTF file that the source lacks.

The sources are samples and made files and, if `DFD_MESHES` names a folder of meshes, the meshes in this folder and in
the folders `corpus`, `reports` and `lessons/rigs` beside it.
"""

import json
import os
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, checkered, obj_cube, ply, scene_of_three, textured_quad, write
from scipy.spatial.transform import Rotation

import dfd
from dfd.mesh.mesh import Mesh

VALIDATOR = Path(__file__).parents[4] / "validator"
GIVEN = os.environ.get("DFD_MESHES")
BESIDE = ("corpus", "reports", "lessons/rigs")
FOLDERS = [Path(GIVEN), *(Path(GIVEN).parent / each for each in BESIDE)] if GIVEN else []
ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
MOST_BYTES = 3_000_000  # of a source; larger files take seconds each
TURN = Rotation.from_rotvec([0.3, -0.5, 0.7])


def made(folder):
    """Write files of all formats, with tangents, morph targets, textures, colors, labels and gaps."""
    for name in ("chair", "quadruped", "robot"):
        for ending in ("obj", "glb"):
            getattr(dfd.samples, name)(4000).mesh.save(folder / f"{name}.{ending}")
    scene_of_three(folder)
    gltf = textured_quad(
        folder,
        NORMAL=(np.tile([0.0, 0, 1], (4, 1)), 5126, "VEC3"),
        TANGENT=(np.tile([1.0, 0, 0, 1], (4, 1)), 5126, "VEC4"),
    )
    moves = {
        "POSITION": gltf.accessor(np.tile([0.0, 0, 0.5], (4, 1)), 5126, "VEC3"),
        "TANGENT": gltf.accessor(np.tile([0.0, 0.25, 0], (4, 1)), 5126, "VEC3"),
    }
    for index, low, high in ((moves["POSITION"], [0, 0, 0.5], [0, 0, 0.5]), (3, [0, 0, 0], [1, 1, 0])):
        gltf.header["accessors"][index] |= {"min": low, "max": high}
    gltf.header["meshes"][0]["primitives"][0]["targets"] = [moves]
    write(folder / "tangents.glb", gltf.glb())
    checkered(folder / "paint.png")
    write(folder / "a.mtl", "newmtl m\nmap_Kd -s 2 1 1 -o 0.5 0 paint.png\n")
    quad = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 2\nusemtl m\n"
    write(folder / "scaled.obj", f"{quad}f 1/1/1 2/1/1 3/1/1\nf 1/1 3/1 4/1\n")
    write(folder / "plain.obj", obj_cube())
    rows = [f"{x:g} {y:g} {z:g}" for x, y, z in CORNERS.tolist()]
    faces = ["3 {} {} {}".format(*face) for face in CUBE]
    write(folder / "colors.off", "\n".join(["COFF", "8 12 0", *(f"{row} 255 0 0 255" for row in rows), *faces, ""]))
    values = [f"{row} 16777217 nan" for row in rows]
    write(folder / "labels.ply", ply(["int label", "float quality"], values, faces=faces))
    Mesh(CORNERS, CUBE).save(folder / "cube.stl")
    return sorted(path for path in folder.iterdir() if path.suffix in ENDINGS)


def errors(paths):
    """Return the codes of the errors that the validator finds in each file."""
    done = subprocess.run(
        ["node", VALIDATOR / "validate.mjs", *paths], check=True, capture_output=True, text=True, cwd=VALIDATOR
    )
    found = json.loads(done.stdout)
    return {path: {each["code"] for each in found[str(path)] if each["severity"] == 0} for path in paths}


def check(sources, folder):
    """Save all sources with several motions, compare the errors, and return the number of saved files."""
    saved: list[tuple[Path, Path]] = []
    for number, path in enumerate(sources):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of gaps, rounding and missing materials
            try:
                mesh = dfd.load(path)
            except ValueError:
                continue
            size = float(mesh.extents.max())
            if not 0 < size < 1e30:
                continue
            motions = {
                "turned": TURN.apply(mesh.vertices.copy()),
                "shifted": mesh.vertices + 0.1 * size,
                "bent": mesh.vertices + 0.1 * size * np.sin(3 * mesh.vertices / size)[:, [1, 2, 0]],
            }
            for name, vertices in motions.items():
                target = folder / f"{number}_{name}.{'gltf' if name == 'bent' else 'glb'}"
                mesh.save(target, vertices)
                saved.append((path, target))
    own = errors([path for path in sources if path.suffix.lower() in (".glb", ".gltf")])
    new = errors([target for _, target in saved])
    worse = {target.name: (path, new[target] - own.get(path, set())) for path, target in saved}
    assert not {name: each for name, each in worse.items() if each[1]}
    return len(saved)


@pytest.fixture(autouse=True)
def _validator():
    if shutil.which("node") is None or not (VALIDATOR / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("the validator is not installed (npm ci in tests/validator): no file was validated")


def test_a_saved_file_has_no_error_that_its_source_lacks(tmp_path):
    (tmp_path / "sources").mkdir()
    assert check(made(tmp_path / "sources"), tmp_path) == 3 * 13


@pytest.mark.slow
@pytest.mark.skipif(not FOLDERS, reason="DFD_MESHES names no folder of meshes")
@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: path.name)
def test_files_of_the_world_have_no_error_that_their_sources_lack(folder, tmp_path):
    found = [each for each in sorted(folder.rglob("*")) if each.suffix.lower() in ENDINGS]
    check([each for each in found if each.stat().st_size <= MOST_BYTES], tmp_path)
