"""Test that an edit file of version 1, with every key, still gives the vertices that were stored with it."""

import json
from pathlib import Path

import numpy as np
from made_field import made_field

import dfd

GOLDEN = Path(__file__).parent / "golden"


def figure() -> dfd.Mesh:
    """Return an ellipsoid with 266 vertices: two poles, and 11 rings of 24 vertices."""
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


def test_an_edit_of_version_1_poses_the_shape_as_it_did():
    mesh = figure()
    field = made_field(16, seed=1, width=32, layers=2, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents))
    moved = dfd.Deformer.load(GOLDEN / "v1.json", mesh, field).vertices[::7]
    np.testing.assert_allclose(moved, json.loads((GOLDEN / "v1_posed.json").read_text()), atol=1e-4)
    assert np.abs(moved - mesh.vertices[::7]).max() > 0.1
