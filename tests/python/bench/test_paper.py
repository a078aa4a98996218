"""The paper's figures and tables: every page on a small shape, and the methods beside ours."""

from __future__ import annotations

import json
import os
import re
import time
from itertools import product

import numpy as np
import pytest
import trimesh
from tiny_encoder import save_tiny_encoder

import dfd
from bench.paper import comparisons, page, resolution
from bench.paper.__main__ import PAGES
from bench.paper.comparisons import Case, constraints, farthest
from bench.paper.features import roughness
from bench.paper.page import Context, write
from bench.paper.peers import PEERS
from bench.paper.peers.biharmonic import bilaplacian
from bench.paper.peers.peer import Body, Done, Job, PeerError, Tetrahedra, in_child, run
from bench.paper.resolution import defects, gap

igl = pytest.importorskip("igl")

MOVE = np.array([0.0, 0.5, 0.25])
TINY = {"views": 4, "resolution": 32, "steps": 5, "batch": 64, "up": "file"}


@pytest.fixture(scope="module")
def ball() -> dfd.Mesh:
    made = trimesh.creation.icosphere(subdivisions=3)
    return dfd.Mesh(made.vertices, made.faces)


@pytest.fixture(scope="module")
def ends(ball) -> list[int]:
    """Its top and its bottom."""
    return [int(ball.vertices[:, 1].argmax()), int(ball.vertices[:, 1].argmin())]


def case_of(mesh: dfd.Mesh, ends: list[int], **more) -> Case:
    held = np.array(ends)
    to = mesh.vertices[held] + [MOVE, 0 * MOVE]
    return Case(mesh, held[:1], to[:1], held[1:], held, to, **more)


def test_neighbors_go_along_with_the_nearest_point(ball, ends):
    job = constraints(case_of(ball, ends), 0.1)
    distance = np.linalg.norm(ball.vertices[:, None] - ball.vertices[ends], axis=2).min(axis=1)
    assert job.held.tolist() == np.flatnonzero(distance <= 0.2).tolist()
    upper = ball.vertices[job.held, 1] > 0
    np.testing.assert_allclose(job.targets - ball.vertices[job.held], np.where(upper[:, None], MOVE, 0), atol=1e-12)
    assert job.group.tolist() == np.where(upper, 0, -1).tolist()
    for alone in (constraints(case_of(ball, ends), 0.0), constraints(case_of(ball, ends, dense=True), 0.1)):
        assert alone.held.tolist() == sorted(ends)


# --- pages


@pytest.fixture
def small(monkeypatch) -> None:
    """Small pictures of coarse shapes; other methods, and the search for planes, have tests of their own."""
    seconds = dict.fromkeys(("tetrahedra", "prepare", "bind", "pose"), 0.5)
    monkeypatch.setattr(page, "RESOLUTION", 48)
    monkeypatch.setattr(page, "LONGEST_EDGE", 0.2)
    monkeypatch.setattr(resolution, "FACES", (300, 900))
    monkeypatch.setattr("dfd.editing.influence.grips.symmetry_planes", lambda field, mesh: [])
    for module in (comparisons, resolution):
        monkeypatch.setattr(module, "run", lambda make, mesh, jobs, **_: [Done(mesh.vertices, seconds) for _ in jobs])


@pytest.fixture(scope="module")
def context(tmp_path_factory) -> Context:
    """One file with a shape of two pieces."""
    body = trimesh.creation.icosphere(subdivisions=2)
    body.vertices *= (0.6, 1, 0.8)
    foot = trimesh.creation.box((0.5, 0.2, 0.5)).subdivide().apply_translation((0, -1.05, 0.2))
    folder = tmp_path_factory.mktemp("meshes")
    trimesh.util.concatenate([body, foot]).export(folder / "thing.ply")
    encoder = save_tiny_encoder(tmp_path_factory.mktemp("encoder"))
    return Context(folder=folder, quick=True, encoder=encoder, settings=TINY)


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_every_page_is_made(name, context, tmp_path, small, one_thread):
    text = write(PAGES[name](context), name, tmp_path, context).read_text("utf-8")
    assert "thing" in text
    for link in re.findall(r"\]\((.+?)\)", text):
        assert (tmp_path / link).stat().st_size > 1000
    numbers = json.loads((tmp_path / f"{name}.json").read_text("utf-8"))
    assert set(numbers["presets"]) == {"paper preset", "dfd default"}


def test_surfaces_are_measured():
    box, far = trimesh.creation.box(), (1.001, 0, 0)
    for offset, count in (((1, 1, 0), 1), ((1, 1, 1), 1), ((3, 0, 0), 0)):  # along an edge, at a vertex, apart
        both = trimesh.util.concatenate([box, box.copy().apply_translation(offset)])
        assert defects(dfd.Mesh(both.vertices, both.faces)).non_manifold == count
    assert defects(dfd.Mesh(box.vertices, box.faces)).holes == 0
    assert defects(dfd.Mesh(box.vertices, box.faces[1:])).holes == 1
    both = trimesh.util.concatenate([box, box.copy().apply_translation(far)])
    mesh = dfd.Mesh(both.vertices, both.faces)
    assert gap(mesh, mesh.vertices + (mesh.vertices[:, :1] > 0.5005) * (0.25, 0, 0)) == pytest.approx(0.25)
    cube = dfd.Mesh(box.vertices, box.faces)  # x has slope 1 on four of six sides and 0 on the two across it
    assert roughness(cube, 3 * cube.vertices[:, 0]) == pytest.approx(3 * 4 / 6 * cube.diagonal)


# --- peers


@pytest.fixture(scope="module")
def body() -> Body:
    """A block filled with tetrahedra whose boundary is the surface itself."""
    corners = ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7))
    grid = np.arange(216).reshape(6, 6, 6)
    nodes = np.array(list(product(range(6), repeat=3)), float) * (0.2, 0.4, 0.3)
    cubes = [grid[x : x + 2, y : y + 2, z : z + 2].ravel() for x, y, z in product(range(5), repeat=3)]
    cells = np.array([cube[list(each)] for cube in cubes for each in corners])
    used, faces = np.unique(np.asarray(igl.boundary_facets(cells)[0]), return_inverse=True)
    shares = np.tile([1.0, 0.0, 0.0], (len(used), 1))
    within = Tetrahedra(nodes, cells, np.stack([used] * 3, axis=1), shares, 0.0)
    return Body(nodes[used], faces.reshape(-1, 3).astype(np.int64), within)


def made(name, body, held):
    peer = PEERS[name]()
    peer.prepare(body)
    peer.bind(held, np.arange(len(held)))
    return peer


@pytest.mark.parametrize("name", PEERS)
def test_handles_reach_their_targets_and_a_move_of_all_moves_the_shape(body, name):
    held = farthest(body.vertices, 8)
    peer, targets = made(name, body, held), body.vertices[held].copy()
    np.testing.assert_allclose(peer.deform(targets + (0, 1, 2)), body.vertices + (0, 1, 2), atol=1e-6)
    targets[0] += (0.1, 0.2, 0.0)
    size = np.linalg.norm(np.ptp(body.vertices, axis=0))
    moved = peer.deform(targets)
    np.testing.assert_allclose(moved[held], targets, atol=0.02 * size if name == "NeuralMLS" else 1e-6)
    if name != "ARAP":
        np.testing.assert_allclose(np.asarray(peer.weights).sum(axis=1), 1, atol=1e-5)


def test_biharmonic_coordinates_are_affinely_exact_and_have_the_least_energy(body):
    held = farthest(body.vertices, 8)
    weights, nodes = made("biharmonic", body, held).weights, body.within.nodes
    handles = np.unique(body.within.nearest(body.vertices[held]))
    np.testing.assert_allclose(weights @ nodes[handles], nodes, atol=1e-8)
    energy = bilaplacian(nodes, body.within.cells)
    slope = energy @ weights
    slope[handles] = 0
    assert abs(slope).max() < 1e-8 * abs(energy).max()
    np.testing.assert_allclose(made("OptCtrlPoints", body, held).weights, weights, atol=1e-8)


def test_what_a_method_cannot_do_is_told(body):
    with pytest.raises(PeerError, match="needs four handles that do not lie in a plane"):
        made("biharmonic", body, np.flatnonzero(body.vertices[:, 0] == 0)[[0, 3, 9, 20, 30]])
    assert in_child(len, np.zeros(1_000_000), seconds=60) == 1_000_000  # more than a pipe holds
    for call, given, message in (
        (os._exit, 3, r"crashes \(exit code 3\)"),
        (time.sleep, 60, r"takes longer than 10 s"),
        (int, "x", "invalid literal"),
    ):
        with pytest.raises(PeerError, match=message):
            in_child(call, given, seconds=10)


@pytest.mark.slow
def test_a_shape_is_filled_and_every_step_is_timed(ball):
    pytest.importorskip("wildmeshing")
    handles = farthest(ball.vertices, 6)
    jobs = [Job(handles, np.arange(6), ball.vertices[handles] + move) for move in ((0, 0, 0), (0, 1, 0))]
    for done, move in zip(run(PEERS["biharmonic"], ball, jobs), (0, 1), strict=True):
        np.testing.assert_allclose(done.vertices, ball.vertices + (0, move, 0), atol=1e-6)
        assert set(done.seconds) == {"tetrahedra", "prepare", "bind", "pose"}
