"""Save every file with an edit by every export, and compare the positions with the session's; save all unedited too.

The files are those of tests/corpus and, if `DFD_MESHES` names a folder of meshes, of this folder and of the folders
`corpus` and `reports` beside it.
"""

import os
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

import dfd
from dfd.export.gltf.skin import parts_with_deformers

ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
CORPUS = Path(__file__).parents[2] / "corpus"
GIVEN = os.environ.get("DFD_MESHES")
FOLDERS = [CORPUS, *([Path(GIVEN), *(Path(GIVEN).parent / each for each in ("corpus", "reports"))] if GIVEN else [])]
FILES = [
    path
    for folder in FOLDERS
    for path in sorted(folder.rglob("*"))
    if path.suffix.lower() in ENDINGS and path.stat().st_size < 2e5
]


def load_if_readable(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of missing materials, and of rounding
        try:
            return dfd.load(path)
        except ValueError:
            pytest.skip("the file is refused")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_every_export_shows_the_edit(path, tmp_path, make_session):
    mesh = load_if_readable(path)
    session = make_session(mesh)
    size = float(mesh.extents.max())
    if not 0 < size < 1e30:
        pytest.skip("the shape has no size, or is too large for 32-bit floats")
    used = np.unique(mesh.faces)
    top = int(used[mesh.vertices[used, 1].argmax()])
    session.add(top, translation=(0.05 * size, 0.1 * size, 0.3 * size), rotation=(0, 0, 20))
    wanted = session.vertices[mesh.faces]
    taken = parts_with_deformers(mesh)
    forms = [] if taken[0] else ["skin"]
    forms += [] if taken[1] else ["morph"]
    for name in (*(f"baked{ending}" for ending in ENDINGS), *(f"{form}.glb" for form in forms)):
        form = name.split(".")[0]
        influences = "all" if form == "skin" else None
        dfd.export_rig(session, tmp_path / name, form=form, influences=influences)
        found = load_if_readable(tmp_path / name)
        assert found.faces.shape == mesh.faces.shape, name
        shown = found.vertices[found.faces]
        if form == "baked" and path.suffix.lower() == Path(name).suffix:
            shown = found.vertices[mesh.faces]  # a bent polygon of the file may be divided along another diagonal
        assert np.abs(shown - wanted).max() <= 1e-5 * np.abs(wanted).max(), name


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_file_without_an_edit_keeps_its_bytes(path, tmp_path):
    copy = tmp_path / path.name
    shutil.copy(path, copy)
    load_if_readable(copy).save(tmp_path / f"same{path.suffix}")
    assert (tmp_path / f"same{path.suffix}").read_bytes() == path.read_bytes()
