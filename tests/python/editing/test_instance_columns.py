"""Handles that move several instances, each about its own pivot."""

import sys
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

import dfd
from dfd.posing.transforms import affine, rotation_matrix


@dataclass
class Found:
    vertex: int
    pivot: np.ndarray
    frame: np.ndarray
    share: np.ndarray


@pytest.fixture(scope="module")
def sample():
    return dfd.samples.chair(4000)


@pytest.fixture
def asked(sample, mesh, monkeypatch):
    """Instances that are the legs of a chair, by its labels: what was asked of whoever finds them."""
    calls = []

    def find_instances(mesh_, features, handle_vertex, weights, *, symmetry=None):
        calls.append((handle_vertex, symmetry))
        found = []
        for leg in sorted(range(4), key=lambda leg: leg != sample.instances[handle_vertex]):
            members = sample.vertices_of("leg", leg)
            share = np.zeros(len(mesh_.vertices), np.float32)
            share[members] = 1
            foot = int(members[mesh_.vertices[members, 1].argmin()])
            frame = np.diag([1.0 if leg % 2 == sample.instances[handle_vertex] % 2 else -1.0, 1, 1])
            found.append(Found(foot, mesh_.vertices[members].mean(axis=0), frame, share))
        return found

    monkeypatch.setitem(sys.modules, "dfd.editing.instances", SimpleNamespace(find_instances=find_instances))
    return calls


@pytest.fixture
def session(mesh, field, sample):
    features = np.zeros((len(mesh.vertices), 16), np.float32)
    features[:, 0] = 1
    legs = sample.vertices_of("leg")
    features[legs] = np.eye(16)[1]
    back = legs[sample.instances[legs] >= 2]
    features[back, 1:3] = (np.cos(0.5), np.sin(0.5))
    return dfd.Deformer(mesh, field, features=features)


@pytest.fixture
def foot(sample, mesh):
    members = sample.vertices_of("leg", 0)
    return int(members[mesh.vertices[members, 1].argmin()])


def leg(sample, number):
    return sample.vertices_of("leg", number)


def test_each_instance_turns_about_its_own_pivot_in_its_own_frame(session, sample, mesh, asked, foot):
    rotation = (0, 40, 0)
    session.add(foot, rotation=rotation, translation=(0.1, 0, 0), instances="own")
    for number in (0, 1):
        members = leg(sample, number)
        turn, sign = rotation_matrix(rotation), 1.0 if number == 0 else -1.0
        frame = np.diag([sign, 1, 1])
        center = mesh.vertices[members].mean(axis=0)
        wanted = (mesh.vertices[members] - center) @ (frame @ turn @ frame).T + center + (sign * 0.1, 0, 0)
        np.testing.assert_allclose(session.vertices[members], wanted, atol=1e-6)
    others = np.setdiff1d(np.arange(len(mesh.vertices)), sample.vertices_of("leg"))
    np.testing.assert_allclose(session.vertices[others], mesh.vertices[others], atol=1e-12)
    assert asked == [(foot, None)]
    assert session.weights.shape[1] == 1
    assert session.report().handles[0].instances == 4
    assert "each of 4 instances about its own pivot" in str(session.report())


def test_a_pivot_that_is_given_lies_from_each_counterpart_as_from_the_handle(session, sample, mesh, asked, foot):
    offset = np.array([0.05, 0.1, 0.0])
    session.add(foot, scale=2, pivot=mesh.vertices[foot] + offset, instances="own")
    members = leg(sample, 1)
    pivot = mesh.vertices[members[mesh.vertices[members, 1].argmin()]] + offset * (-1, 1, 1)
    np.testing.assert_allclose(session.vertices[members], pivot + 2 * (mesh.vertices[members] - pivot), atol=1e-6)


def test_only_moves_the_handle_s_own(session, sample, mesh, asked, foot):
    session.add(foot, translation=(0, -0.2, 0), instances="only")
    own, others = leg(sample, 0), np.concatenate([leg(sample, i) for i in (1, 2, 3)])
    np.testing.assert_allclose(session.vertices[own], mesh.vertices[own] - (0, 0.2, 0), atol=1e-6)
    np.testing.assert_allclose(session.vertices[others], mesh.vertices[others], atol=1e-12)


@pytest.mark.parametrize("instances", ["own", "together"])
def test_level_brings_all_instances_to_full_weight(session, sample, mesh, asked, foot, instances):
    handle = session.add(foot, translation=(0, -0.2, 0), instances=instances)
    back = leg(sample, 2)
    half = session.vertices[back] - mesh.vertices[back]
    assert 0.05 < -half[:, 1].mean() < 0.15
    session.change(handle, level=True)
    np.testing.assert_allclose(session.vertices[back], mesh.vertices[back] - (0, 0.2, 0), atol=1e-6)
    session.undo()
    np.testing.assert_allclose(session.vertices[back] - mesh.vertices[back], half, atol=1e-12)


def test_together_is_the_paper_and_asks_nobody(session, mesh, asked, foot):
    session.add(foot, rotation=(0, 40, 0), instances="together")
    wanted = dfd.pose(mesh.vertices, session.weights, [affine(rotation=(0, 40, 0), pivot=mesh.vertices[foot])])
    np.testing.assert_allclose(session.vertices, wanted, atol=1e-12)
    assert asked == []


def test_instances_are_found_once_for_a_drag(session, mesh, field, asked, foot):
    handle = session.add(foot, instances="own")
    other = session.add(5, translation=(0, 0.01, 0))
    session.add(6)
    session.add(7)
    _ = session.vertices
    for frame in range(5):
        session.move(handle, rotation=(0, 10 * frame, 0), merge=frame > 0)
        dragged = session.vertices
    assert asked == [(foot, None)]
    fresh = dfd.Deformer(mesh, field, features=session.features)
    fresh.apply(session.edit)
    np.testing.assert_allclose(dragged, fresh.vertices, atol=1e-12)
    session.move(other, translation=(0, 0.02, 0))
    _ = session.vertices
    session.symmetry = "x"
    _ = session.vertices
    assert [symmetry for _, symmetry in asked] == [None, None, session.symmetry]
    session.undo()


def test_a_handle_without_instances_is_said(session, foot, monkeypatch):
    nobody = SimpleNamespace(find_instances=lambda *_, **__: [])
    monkeypatch.setitem(sys.modules, "dfd.editing.instances", nobody)
    session.add(foot, instances="own", translation=(0, 1, 0))
    with pytest.raises(ValueError, match=f"`instances` of handle 1 at {foot} cannot be told apart: there is none"):
        _ = session.vertices
