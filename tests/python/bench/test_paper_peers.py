"""The methods of bench/paper/peers, each by what must hold of it."""

from __future__ import annotations

import sys
from itertools import product

import numpy as np
import pytest
import trimesh

import dfd
from bench.paper.comparisons import farthest
from bench.paper.peers import PEERS
from bench.paper.peers.biharmonic import bilaplacian
from bench.paper.peers.peer import Body, Job, PeerError, Tetrahedra, run

igl = pytest.importorskip("igl")

SIDE = 5  # cells along each side of the block
CORNERS = ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7))  # around the diagonal


@pytest.fixture(scope="module")
def body() -> Body:
    """A block filled with tetrahedra whose boundary is the surface itself."""
    count = SIDE + 1
    nodes = np.array(list(product(range(count), repeat=3)), float) * (0.2, 0.4, 0.3)
    cells = []
    for x, y, z in product(range(SIDE), repeat=3):
        of_cell = [((x + a) * count + y + b) * count + z + c for a, b, c in product((0, 1), repeat=3)]
        cells += [[of_cell[4 * (k >> 2) + (k & 3)] for k in each] for each in CORNERS]
    cells = np.array(cells)[:, [0, 2, 1, 3]]
    facets = np.asarray(igl.boundary_facets(cells)[0])
    used, faces = np.unique(facets, return_inverse=True)
    own = np.stack([used] * 3, axis=1)
    shares = np.tile([1.0, 0.0, 0.0], (len(used), 1))
    return Body(nodes[used], faces.reshape(-1, 3).astype(np.int64), Tetrahedra(nodes, cells, own, shares, 0.0))


@pytest.fixture(scope="module")
def held(body) -> np.ndarray:
    return farthest(body.vertices, 8)


def made(name, body, held, group=None):
    peer = PEERS[name]()
    peer.prepare(body)
    peer.bind(held, np.arange(len(held)) if group is None else group)
    return peer


@pytest.mark.parametrize("name", PEERS)
def test_handles_at_rest_leave_the_shape_and_a_move_of_all_moves_it(body, held, name):
    peer = made(name, body, held)
    np.testing.assert_allclose(peer.deform(body.vertices[held]), body.vertices, atol=1e-6)
    np.testing.assert_allclose(peer.deform(body.vertices[held] + (0, 1, 2)), body.vertices + (0, 1, 2), atol=1e-6)


@pytest.mark.parametrize("name", PEERS)
def test_handles_reach_their_targets_and_nothing_given_changes(body, held, name):
    before, targets = body.vertices.copy(), body.vertices[held].copy()
    targets[0] += (0.1, 0.2, 0.0)
    moved = made(name, body, held).deform(targets)
    size = np.linalg.norm(np.ptp(before, axis=0))
    np.testing.assert_allclose(moved[held], targets, atol=0.02 * size if name == "NeuralMLS" else 1e-6)
    np.testing.assert_array_equal(body.vertices, before)


def test_weights_sum_to_one_and_bounded_ones_keep_their_bounds(body, held):
    for name in ("biharmonic", "OptCtrlPoints", "BBW", "NeuralMLS"):
        weights = np.asarray(made(name, body, held).weights)
        np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)
        if name in ("BBW", "NeuralMLS"):
            assert weights.min() > -1e-6


def test_biharmonic_coordinates_are_affinely_exact_and_have_the_least_energy(body, held):
    weights = made("biharmonic", body, held).weights
    nodes, handles = body.within.nodes, np.unique(body.within.nearest(body.vertices[held]))
    np.testing.assert_allclose(weights @ nodes[handles], nodes, atol=1e-8)
    energy = bilaplacian(nodes, body.within.cells)
    least = np.einsum("nk,nk->k", weights, energy @ weights)
    change = np.random.default_rng(0).normal(size=(len(nodes), 1)) * 1e-3
    change[handles] = 0
    assert (np.einsum("nk,nk->k", weights + change, energy @ (weights + change)) > least).all()
    slope = energy @ weights
    slope[handles] = 0
    assert abs(slope).max() < 1e-8 * abs(energy).max()


def test_the_energy_of_affine_functions_is_nothing(body):
    energy = bilaplacian(body.within.nodes, body.within.cells)
    assert abs(energy @ np.c_[np.ones(len(body.within.nodes)), body.within.nodes]).max() < 1e-8 * abs(energy).max()
    assert np.linalg.matrix_rank(energy.toarray()) == len(body.within.nodes) - 4


def test_the_small_system_has_the_weights_of_the_large_one(body, held):
    np.testing.assert_allclose(
        made("OptCtrlPoints", body, held).weights, made("biharmonic", body, held).weights, atol=1e-8
    )
    one = made("OptCtrlPoints", body, held[:1]).weights
    np.testing.assert_allclose(one[made("OptCtrlPoints", body, held[:1]).within.nearest(body.vertices[held[:1]])], 1)


def test_points_that_stay_are_one_group(body, held):
    group = np.where(np.arange(len(held)) == 0, 0, -1)
    targets = body.vertices[held].copy()
    targets[0] += (0.0, 0.5, 0.0)
    peer = made("BBW", body, held, group)
    assert peer.weights.shape[1] == 2
    moved = peer.deform(targets)
    np.testing.assert_allclose(moved[held], targets, atol=1e-6)


def test_what_a_method_cannot_do_is_told(body, held, monkeypatch):
    flat = np.flatnonzero(body.vertices[:, 0] == 0)[[0, 3, 9, 20, 30]]
    with pytest.raises(PeerError, match="needs four handles that do not lie in a plane"):
        made("biharmonic", body, flat)
    apart = Body(
        np.concatenate([body.vertices, body.vertices + 9]),
        np.concatenate([body.faces, body.faces + len(body.vertices)]),
    )
    with pytest.raises(PeerError, match="on every one of the 2 components"):
        made("ARAP", apart, held)
    monkeypatch.setitem(sys.modules, "igl", None)
    for name in ("ARAP", "BBW"):
        with pytest.raises(PeerError, match="libigl is not installed"):
            made(name, body, held)


@pytest.mark.slow
def test_a_shape_is_filled_and_every_step_is_timed():
    pytest.importorskip("wildmeshing")
    ball = trimesh.creation.icosphere(subdivisions=2)
    mesh = dfd.Mesh(ball.vertices, ball.faces)
    handles = farthest(mesh.vertices, 6)
    jobs = [Job(handles, np.arange(6), mesh.vertices[handles] + move) for move in ((0, 0, 0), (0, 1, 0))]
    still, moved = run(PEERS["biharmonic"], mesh, jobs)
    np.testing.assert_allclose(still.vertices, mesh.vertices, atol=1e-8)
    np.testing.assert_allclose(moved.vertices, mesh.vertices + (0, 1, 0), atol=1e-6)
    assert set(moved.seconds) == {"tetrahedra", "prepare", "bind", "pose"}
    assert min(moved.seconds.values()) >= 0
    with pytest.raises(PeerError, match="needs four handles"):
        run(PEERS["biharmonic"], mesh, [Job(handles[:2], np.arange(2), mesh.vertices[handles[:2]])])
