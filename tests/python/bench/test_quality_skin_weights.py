"""The table of skin weights, on a rig of two bones whose motion is computed by hand."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from made_field import field_of
from mesh_files import Gltf, write

import dfd
from bench.quality.baselines import PeerError
from bench.skins.skin_peers import bounded_biharmonic, geodesic_voxels
from bench.skins.skin_weights import _off, compared, motions
from dfd.export.bones import Bones, bones_of
from dfd.mesh.file.primitives import Primitive

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
    mesh = dfd.load(rig, pose="bind")
    moves = motions(mesh, bones_of(mesh))
    assert len(moves) == 8
    end = np.append(mesh.vertices[2], 1)  # at x = 4: the node is twice as large, which a skin does not know
    np.testing.assert_allclose(moves[0][1] @ end, (2, 0, 0, 1), atol=1e-6)
    angle = np.pi / 2 * 4 / 8
    np.testing.assert_allclose(moves[4][1] @ end, (1 + np.cos(angle), np.sin(angle), 0, 1), atol=1e-6)


def test_weights_that_differ_are_off_by_how_far_they_move(rig):
    mesh = dfd.load(rig, pose="bind")
    bones = bones_of(mesh)
    turned = motions(mesh, bones)[4:5]
    difference = np.zeros_like(bones.weights)
    assert _off(mesh, bones, difference, turned) == 0
    difference[2] = (1, -1)  # the tip stays where it was
    chord = 2 * np.sin(np.pi / 8)
    corner = np.array([1 + np.cos(np.pi / 4), np.sin(np.pi / 4) + 0.1 * np.cos(np.pi / 4)])
    assert _off(mesh, bones, difference, turned) == pytest.approx(chord / 6 / np.linalg.norm(corner), rel=1e-4)
    assert np.isnan(_off(mesh, bones, difference, []))


def test_the_artist_is_not_off_from_the_artist(rig):
    mesh = dfd.load(rig, pose="bind")
    field_of(mesh).save(rig.with_name("strip.field.safetensors"))
    artist, _, off, *others = compared(rig, mesh, bones_of(mesh), rig.parent)
    assert (artist, off) == (0, 0)
    straight, voxels, _, ours = np.array(others).reshape(4, 3)
    assert np.isfinite([straight, voxels, ours]).all()


def bent_tube():
    """A square tube bent like a U, two bones in each arm that lie 0.4 apart: (V, 3), (F, 3)."""
    path = np.array([(0, 2 - 0.1 * n, 0) for n in range(20)] + [(0.1 * n, 0, 0) for n in range(5)])
    path = np.concatenate([path, [(0.4, 0.1 * n, 0) for n in range(1, 21)]])
    ring = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.08
    across = np.array([(1.0, 0, 0)] * 20 + [(0, 1.0, 0)] * 5 + [(-1.0, 0, 0)] * 20)
    across[[20, 24]] = np.array([(1, 1, 0), (-1, 1, 0)]) * 0.7
    points = [center + u * side + v * np.array([0, 0, 1]) for center, side in zip(path, across, strict=True)
              for u, v in ring]  # fmt: skip
    faces = []
    for n in range(len(path) - 1):
        for k in range(4):
            a, b = 4 * n + k, 4 * n + (k + 1) % 4
            faces += [(a, b, b + 4), (a, b + 4, a + 4)]
    last = 4 * len(path) - 4
    faces += [(0, 2, 1), (0, 3, 2), (last, last + 1, last + 2), (last, last + 2, last + 3)]
    return np.array(points), np.array(faces)


@pytest.fixture
def tube():
    vertices, faces = bent_tube()
    starts = np.array([(0, 2.0, 0), (0.4, 0.1, 0)])
    ends = np.array([(0, 0.1, 0), (0.4, 2.0, 0)])
    mesh = dfd.Mesh(vertices, faces)
    part = Primitive("tube", "tube", None, rows=slice(0, len(vertices)), faces=slice(0, len(faces)))
    skinned = np.ones(len(vertices), bool)
    return mesh, Bones(mesh, ("one", "other"), starts, ends, np.array([0, 1]), np.eye(2)[:1].repeat(len(vertices), 0),
                       skinned, (part,))  # fmt: skip


def test_voxels_know_the_way_through_the_body(tube):
    """The arms are 0.4 apart through space, and up to 4 through the body."""
    mesh, bones = tube
    weights = geodesic_voxels(mesh, bones, np.array([0, 1]))
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    ends = mesh.vertices[:, 1] > 1.5
    left = mesh.vertices[:, 0] < 0.2
    assert weights[ends & left, 0].min() > 0.999
    assert weights[ends & ~left, 1].min() > 0.999
    middle = np.abs(mesh.vertices[:, 0] - 0.2) < 1e-9
    np.testing.assert_allclose(weights[middle, 0], 0.5, atol=0.1)


def test_a_bone_that_no_way_leads_to_has_no_weight(tube):
    mesh, bones = tube
    apart = np.concatenate([mesh.vertices, mesh.vertices + (9, 0, 0)])
    faces = np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)])
    part = Primitive("two", "two", None, rows=slice(0, len(apart)), faces=slice(0, len(faces)))
    wide = dfd.Mesh(apart, faces)
    both = Bones(wide, bones.names, bones.starts, bones.ends, bones.joint, np.ones((len(apart), 2)),
                 np.ones(len(apart), bool), (part,))  # fmt: skip
    weights = geodesic_voxels(wide, both, np.array([0, 1]))
    np.testing.assert_array_equal(weights[len(mesh.vertices) :], np.eye(2)[[1]].repeat(len(mesh.vertices), 0))


def test_bounded_biharmonic_weights_within_the_body(tube):
    pytest.importorskip("igl")
    pytest.importorskip("wildmeshing")
    mesh, bones = tube
    weights = bounded_biharmonic(mesh, bones, np.array([0, 1]))
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    ends = mesh.vertices[:, 1] > 1.0
    left = mesh.vertices[:, 0] < 0.2
    assert weights[ends & left, 0].min() > 0.95
    assert weights[ends & ~left, 1].min() > 0.95


def test_what_bounded_biharmonic_weights_lack_is_said(tube, monkeypatch):
    pytest.importorskip("igl")
    mesh, bones = tube
    monkeypatch.setattr("bench.skins.skin_peers.in_child", lambda run, *given, **_: run(*given))
    monkeypatch.setitem(sys.modules, "wildmeshing", None)
    with pytest.raises(PeerError, match="needs wildmeshing, which is not installed"):
        bounded_biharmonic(mesh, bones, np.array([0, 1]))
