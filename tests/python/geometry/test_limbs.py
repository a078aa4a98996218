"""Which way limbs run."""

import numpy as np
import pytest

import dfd
from dfd import Geodesics, Mesh
from dfd.geometry.limbs import limb_at


def distances(mesh, vertex):
    geodesics = Geodesics(mesh)
    return geodesics.distances([vertex])[0] * geodesics.extent


@pytest.mark.parametrize("turn", [np.eye(3), np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0], [0.48, 0.64, 0.6]])])
@pytest.mark.parametrize("end", ["tip", "middle"])
def test_a_tube_runs_along_its_axis(turn, end):
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 17)[:-1], np.linspace(0, 2, 41), indexing="ij")
    vertices = np.stack([0.1 * np.cos(around), along, 0.1 * np.sin(around)], axis=-1).reshape(-1, 3)
    number = np.arange(16 * 41).reshape(16, 41)
    a, b = number, np.roll(number, -1, axis=0)
    quads = np.stack([a[:, :-1], b[:, :-1], b[:, 1:], a[:, 1:]], axis=-1).reshape(-1, 4)
    mesh = Mesh(vertices @ turn.T * 7 + 100, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))
    direction, at_end = limb_at(mesh, distances(mesh, 0 if end == "tip" else 20))
    assert np.linalg.norm(direction) == pytest.approx(1)
    assert at_end == (end == "tip")
    # Away from the rest of the tube, which from its lower end is down.
    assert -direction @ turn[:, 1] > 0.95 if at_end else abs(direction @ turn[:, 1]) > 0.95


def test_a_leg_of_a_chair_runs_down():
    sample = dfd.samples.chair(6000)
    foot = sample.vertices_of("leg", 0)
    foot = int(foot[sample.mesh.vertices[foot, 1].argmin()])
    assert limb_at(sample.mesh, distances(sample.mesh, foot)).direction[1] < -0.95


def test_every_so_many_faces_of_a_fine_mesh_tell_the_same(monkeypatch):
    sample = dfd.samples.chair(6000)
    foot = sample.vertices_of("leg", 0)
    foot = int(foot[sample.mesh.vertices[foot, 1].argmin()])
    whole = limb_at(sample.mesh, distances(sample.mesh, foot))
    monkeypatch.setattr("dfd.geometry.limbs.MOST_FACES", 3000)
    some = limb_at(sample.mesh, distances(sample.mesh, foot))
    assert some.at_end == whole.at_end
    assert some.direction @ whole.direction > 0.98


def test_what_is_round_has_no_limb():
    import trimesh

    ball = trimesh.creation.icosphere(3)
    mesh = Mesh(ball.vertices, ball.faces)
    assert limb_at(mesh, distances(mesh, 0)) is None


def test_what_has_no_extent_has_no_limb():
    point = Mesh(np.ones((3, 3)), [[0, 1, 2]])
    assert limb_at(point, np.zeros(3)) is None
