"""Edits as versions 1 to 4 wrote them, with every key and with as few as may be, mean what they meant then.

`golden/posed.json` holds where every seventh vertex went when the files were written, by the program of that time.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from made_field import made_field

import dfd

GOLDEN = Path(__file__).parent / "golden"
NAMES = sorted(path.stem for path in GOLDEN.glob("v*.json"))


def figure() -> dfd.Mesh:
    """An egg with a longer side, (266, 3) vertices: rings of 24 from pole to pole."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 13)[1:-1], np.arange(24) * np.pi / 12, indexing="ij")
    rings = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=2)
    vertices = np.concatenate([[[0, 1, 0]], rings.reshape(-1, 3), [[0, -1, 0]]]) * (1.0, 1.5, 0.7)
    ring = np.arange(24)
    after = (ring + 1) % 24
    faces = [np.stack([0 * ring, 1 + after, 1 + ring], axis=1)]
    for first in range(1, 1 + 10 * 24, 24):
        faces.append(np.stack([first + ring, first + after, first + 24 + ring], axis=1))
        faces.append(np.stack([first + after, first + 24 + after, first + 24 + ring], axis=1))
    faces.append(np.stack([0 * ring + 265, 241 + ring, 241 + after], axis=1))
    return dfd.Mesh(vertices, np.concatenate(faces).astype(np.int32))


@pytest.fixture(scope="module")
def egg():
    mesh = figure()
    return mesh, made_field(16, seed=1, width=32, layers=2, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents))


def posed(path, mesh, field):
    return dfd.Deformer.load(path, mesh, field).vertices[::7]


@pytest.mark.parametrize("name", NAMES)
def test_an_old_edit_poses_the_shape_as_it_did(egg, name):
    wanted = json.loads((GOLDEN / "posed.json").read_text())[name]
    moved = posed(GOLDEN / f"{name}.json", *egg)
    np.testing.assert_allclose(moved, wanted, atol=1e-4)
    assert np.abs(moved - egg[0].vertices[::7]).max() > 0.1
