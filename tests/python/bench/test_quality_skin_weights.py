"""The table of skin weights, on a rig of two bones whose motion is computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from made_field import made_field
from mesh_files import Gltf, write

import dfd
from bench.quality.skin_weights import _off, compared, motions
from dfd.export.bones import bones_of

PLACES = np.array([(0.0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0.1, 0), (1, 0.1, 0), (2, 0.1, 0)])
FACES = np.array([(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)])


@pytest.fixture
def rig(tmp_path):
    """A strip along x, its right end on a second bone at x = 1 that an animation turns by 90° about z in a second."""
    gltf = Gltf()
    weights = np.zeros((6, 4))
    weights[np.arange(6), (PLACES[:, 0] > 1.5).astype(int)] = 1
    attributes = {
        "JOINTS_0": gltf.accessor([[0, 1, 0, 0]] * 6, 5121, "VEC4"),
        "WEIGHTS_0": gltf.accessor(weights, 5126, "VEC4"),
    }
    gltf.node(name="strip", mesh=gltf.mesh("strip", PLACES, FACES, attributes=attributes), skin=0, scale=[2, 2, 2])
    gltf.node(name="left", children=[2])
    gltf.header["nodes"].append({"name": "right", "translation": [1, 0, 0]})
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[1, 0, 3] = -1
    stored = gltf.accessor(binds.transpose(0, 2, 1).reshape(-1, 16), 5126, "MAT4")
    gltf.header["skins"] = [{"joints": [1, 2], "inverseBindMatrices": stored}]
    half = float(np.sqrt(0.5))
    times = gltf.accessor([[0.0], [1.0]], 5126, "SCALAR")
    turns = gltf.accessor([[0, 0, 0, 1], [0, 0, half, half]], 5126, "VEC4")
    gltf.header["animations"] = [
        {
            "channels": [{"sampler": 0, "target": {"node": 2, "path": "rotation"}}],
            "samplers": [{"input": times, "output": turns, "interpolation": "LINEAR"}],
        }
    ]
    return write(tmp_path / "strip.glb", gltf.glb())


def test_motions_are_those_of_the_animation(rig):
    mesh = dfd.load(rig)
    moves = motions(rig, mesh, bones_of(mesh))
    assert len(moves) == 8
    end = np.append(mesh.vertices[2], 1)  # at x = 4: the node is twice as large, which a skin does not know
    np.testing.assert_allclose(moves[0][1] @ end, (2, 0, 0, 1), atol=1e-6)
    angle = np.pi / 2 * 4 / 8
    np.testing.assert_allclose(moves[4][1] @ end, (1 + np.cos(angle), np.sin(angle), 0, 1), atol=1e-6)


def test_weights_that_differ_are_off_by_how_far_they_move(rig):
    mesh = dfd.load(rig)
    bones = bones_of(mesh)
    turned = motions(rig, mesh, bones)[4:5]
    difference = np.zeros_like(bones.weights)
    assert _off(mesh, bones, difference, turned) == 0
    difference[2] = (1, -1)  # the tip stays where it was
    chord = 2 * np.sin(np.pi / 8)
    corner = np.array([1 + np.cos(np.pi / 4), np.sin(np.pi / 4) + 0.1 * np.cos(np.pi / 4)])
    assert _off(mesh, bones, difference, turned) == pytest.approx(chord / 6 / np.linalg.norm(corner), rel=1e-4)
    assert np.isnan(_off(mesh, bones, difference, []))


def test_the_artist_is_not_off_from_the_artist(rig):
    mesh = dfd.load(rig)
    field = made_field(16, width=32, layers=2, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents))
    field.save(rig.with_name("strip.field.safetensors"))
    artist, _, off, *others = compared(rig, rig.parent)
    assert (artist, off) == (0, 0)
    assert np.isfinite(others).all()
    assert len(others) == 6
