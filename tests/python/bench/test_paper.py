"""Test the page of every figure and table on a small shape, and the methods that DFD is compared with."""

import importlib
import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh
from tiny_encoder import save_tiny_encoder

import dfd
from bench.paper import comparisons, features, page, resolution, subjects
from bench.paper.__main__ import main
from bench.paper.comparisons import JOBS, farthest
from bench.paper.distortion import asymmetry, contact_gap
from bench.paper.figures import CANNOT, FIGURES
from bench.paper.page import Claim, write
from bench.paper.subjects import CASES, Context
from bench.peers import PEERS, biharmonic
from bench.peers.biharmonic import direct, small_system
from bench.peers.given import given
from bench.peers.peer import Body, Done, Job, PeerError, Tetrahedra, run
from bench.quality.shapes import SAMPLES

igl = pytest.importorskip("igl")

neural_mls = importlib.import_module("bench.peers.neural_mls")

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def ball():
    made = trimesh.creation.icosphere(subdivisions=3)
    return dfd.Mesh(made.vertices, made.faces)


# --- pages


@pytest.fixture
def small(monkeypatch):
    """Make pictures small, and replace all samples by a coarse shape of two components.

    Also replace the other methods and the search for planes, which have separate tests.
    """
    body = trimesh.creation.icosphere(subdivisions=2)
    body.vertices *= (0.6, 1, 0.8)
    foot = trimesh.creation.box((0.5, 0.2, 0.5)).subdivide().apply_translation((0, -1.05, 0.2))
    both = trimesh.util.concatenate([body, foot])
    sample = SimpleNamespace(mesh=dfd.Mesh(both.vertices, both.faces))
    monkeypatch.delenv("DFD_MESHES", raising=False)
    monkeypatch.setattr(subjects, "SAMPLES", dict.fromkeys(SAMPLES, lambda: sample))
    monkeypatch.setattr(subjects, "posed_robot", lambda: sample.mesh)
    seconds = dict.fromkeys(("tetrahedra", "prepare", "bind", "pose"), 0.5)
    monkeypatch.setattr(page, "RESOLUTION", 48)
    monkeypatch.setattr(subjects, "QUICK", {"views": 4, "resolution": 32, "steps": 5, "batch": 64, "up": "file"})
    monkeypatch.setattr(subjects, "QUICK_PAPER", {})
    monkeypatch.setattr(subjects, "LONGEST_EDGE", 0.2)
    monkeypatch.setattr(resolution, "FACES", (300, 900))
    monkeypatch.setattr(resolution, "LARGE_FACES", ((300, 900), ()))
    monkeypatch.setattr(features, "DETAILED", (2000, 2000))
    monkeypatch.setattr("dfd.editing.weights.session_weights.symmetry_planes", lambda field, mesh: [])
    for module in (comparisons, resolution):
        monkeypatch.setattr(module, "run", lambda peer, mesh, jobs, **_: [Done(mesh.vertices, seconds) for _ in jobs])


@pytest.fixture(scope="module")
def context(tmp_path_factory):
    encoder = save_tiny_encoder(tmp_path_factory.mktemp("encoder"))
    return Context(quick=True, encoder=encoder)


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_every_page_is_made(name, context, tmp_path, small, one_thread):
    text = write(FIGURES[name], name, tmp_path, context).read_text("utf-8")
    for claim in FIGURES[name].claims:
        line = f"| {claim.paper} | {claim.measured} | {claim.bound} | "
        [cells] = [each.removeprefix(line).split(" | ") for each in text.splitlines() if each.startswith(line)]
        assert all(re.search(": (yes|no|not decided)", cell) for cell in cells)
    for link in re.findall(r"\]\((.+?)\)", text):
        assert (tmp_path / link).stat().st_size > 1000


def test_every_figure_of_the_paper_has_a_page_or_a_reason():
    names = [f"fig{number}" for number in range(1, 25)] + ["table1", "table2", "table3"]
    assert sorted(names) == sorted([*FIGURES, *CANNOT])


def recorded():
    """Return the cells of the table of claims in the reference."""
    text = (ROOT / "docs" / "reference" / "paper.md").read_text("utf-8")
    lines = [line for line in text.splitlines() if line.startswith(("| `fig", "| `table")) and line.count(" | ") == 5]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def test_the_reference_has_every_claim_with_its_bound():
    claims = [
        [f"`{name}`", claim.paper, claim.measured, claim.bound]
        for name, figure in FIGURES.items()
        for claim in figure.claims
    ]
    assert [row[:4] for row in recorded()] == claims


def test_recorded_verdicts_follow_from_the_recorded_numbers():
    decided = 0
    for name, _, measured, _, *cells in recorded():
        [claim] = [each for each in FIGURES[name.strip("`")].claims if each.measured == measured]
        for cell in cells:
            assert re.fullmatch(r"–|not decided|[\d.e+-]+: (yes|no[^*]*)\*?", cell), cell
            number, _, verdict = cell.rstrip("*").partition(": ")
            if verdict:
                decided += 1
                within = claim.least <= float(number) <= claim.most
                assert verdict == ("yes" if within else "no") or verdict.endswith("% agreement")
    assert decided > 10


def test_a_claim_needs_its_marked_places():
    claim = Claim("1", "ratio", lambda rows, own: rows[0]["x"], most=2)
    row = {"method": "a", "agreement %": 100.0, "x": 2.0}
    assert claim.judged([row], "a") == (2.0, "yes")
    assert claim.judged([row | {"x": 2.1}], "a") == (2.1, "no")
    assert claim.judged([row | {"x": float("nan")}], "a")[1] == "not decided"
    assert claim.judged([row | {"agreement %": 79.0}], "a") == (2.0, "no: 79 % agreement")
    assert replace(claim, marked=False).judged([row | {"agreement %": 0.0}], "a")[1] == "yes"


def test_a_leg_that_drops_off_opens_a_gap():
    seat, leg = (
        trimesh.creation.box(sides).subdivide().apply_translation((0, y, 0))
        for sides, y in (((1, 0.2, 1), 0.1), ((0.2, 1, 0.2), -0.5005))
    )
    both = trimesh.util.concatenate([seat, leg])
    mesh, below = dfd.Mesh(both.vertices, both.faces), np.arange(len(both.vertices)) >= len(seat.vertices)
    assert contact_gap(mesh, mesh.vertices + (0, 0.3, 0)) == pytest.approx(0, abs=1e-3)
    dropped = mesh.vertices - below[:, None] * (0, 0.3, 0)
    assert contact_gap(mesh, dropped) == pytest.approx(100)
    stretched = mesh.vertices * np.where(below, 1.3, 1)[:, None] ** (0, 1, 0)
    assert contact_gap(mesh, stretched) < 5
    assert contact_gap(dfd.Mesh(seat.vertices, seat.faces), seat.vertices + 1) is None


def test_asymmetry_is_that_of_the_motion(ball):
    right = ball.vertices[:, 0] > 0.1
    apart = np.array([1.0, 0.7, 0.5])  # three different sides
    mesh = dfd.Mesh(ball.vertices * apart, ball.faces)
    one = mesh.vertices + right[:, None] * (0.1, 0.2, 0.3)
    both = mesh.vertices * (1.5, 1, 1) + (0, 0.1, 0.2)
    assert asymmetry(mesh, both) == pytest.approx(0, abs=1e-6)
    assert asymmetry(mesh, one) > 40
    assert asymmetry(mesh, mesh.vertices) is None
    assert asymmetry(dfd.Mesh(one, mesh.faces), one + 1) is None


@pytest.mark.parametrize("name", CANNOT)
def test_the_command_says_what_it_cannot_make(name, capsys):
    with pytest.raises(SystemExit, match="2"):
        main([name])
    assert f"cannot be made: {CANNOT[name]}"[:30] in capsys.readouterr().err


# --- peers


def block(*counts):
    """Return a block of cubes, `counts` along each axis, with tetrahedra whose boundary is exactly its surface."""
    corners = ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7))
    shape = [count + 1 for count in counts]
    grid = np.arange(np.prod(shape)).reshape(shape)
    nodes = np.array(list(product(*map(range, shape))), float) * (0.2, 0.4, 0.3)
    cubes = [grid[x : x + 2, y : y + 2, z : z + 2].ravel() for x, y, z in product(*map(range, counts))]
    cells = np.array([cube[list(each)] for cube in cubes for each in corners])
    used, faces = np.unique(np.asarray(igl.boundary_facets(cells)[0]), return_inverse=True)
    shares = np.tile([1.0, 0.0, 0.0], (len(used), 1))
    within = Tetrahedra(nodes, cells, np.stack([used] * 3, axis=1), shares, 0.0)
    return Body(nodes[used], faces.reshape(-1, 3).astype(np.int64), within)


@pytest.fixture(scope="module")
def body():
    return block(5, 5, 5)


def made(name, body, held):
    return PEERS[name].prepare(body)(held, np.arange(len(held)))


@pytest.mark.parametrize("name", PEERS)
def test_handles_reach_their_targets_and_a_move_of_all_moves_the_shape(body, name):
    held = farthest(body.vertices, 8)
    deform, targets = made(name, body, held), body.vertices[held].copy()
    np.testing.assert_allclose(deform(targets + (0, 1, 2)), body.vertices + (0, 1, 2), atol=1e-6)
    targets[0] += (0.1, 0.2, 0.0)
    size = np.linalg.norm(np.ptp(body.vertices, axis=0))
    moved = deform(targets)
    np.testing.assert_allclose(moved[held], targets, atol=0.02 * size if name == "NeuralMLS" else 1e-6)


@pytest.mark.parametrize("name", ["biharmonic", "OptCtrlPoints"])
def test_coordinates_reproduce_affine_maps(body, name):
    held = farthest(body.vertices, 8)
    deform, matrix = made(name, body, held), np.array([[1.2, 0.3, 0], [0, 0.8, 0.1], [0.2, 0, 1.1]])
    np.testing.assert_allclose(deform(body.vertices[held] @ matrix.T), body.vertices @ matrix.T, atol=1e-6)


def test_the_small_system_has_the_weights_of_the_direct_solve(body):
    held = farthest(body.vertices, 8)
    first, second = (
        prepare(body.within)(body.within.nearest(body.vertices[held])) for prepare in (direct, small_system)
    )
    np.testing.assert_allclose(first, second, atol=1e-6)
    np.testing.assert_allclose(first.sum(axis=1), 1, atol=1e-5)


def test_weights_of_a_bar_without_inner_nodes_are_unique_and_few():
    bar = block(1, 12, 1)
    held = np.array([0, 27, 25, 50])
    weights = [prepare(bar.within)(bar.within.nearest(bar.vertices[held])) for prepare in (direct, small_system)]
    np.testing.assert_allclose(*weights, atol=1e-4)
    np.testing.assert_allclose(weights[0] @ bar.vertices[held], bar.within.nodes, atol=1e-5)
    assert np.abs(weights).max() < 2


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_small_system_accepts_fewer_than_four_handles(body, count):
    np.testing.assert_allclose(small_system(body.within)(farthest(body.vertices, count)).sum(axis=1), 1, atol=1e-9)


@pytest.mark.parametrize("name", ["biharmonic", "OptCtrlPoints", "BBW"])
def test_weights_that_do_not_sum_to_one_are_refused(body, name, monkeypatch):
    for wrong in ("direct", "small_system"):
        monkeypatch.setattr(biharmonic, wrong, lambda within: lambda nodes: np.ones((len(within.nodes), len(nodes))))
    monkeypatch.setattr(igl, "bbw", lambda nodes, cells, handles, ones: np.zeros((len(nodes), len(handles))))
    with pytest.raises(PeerError, match="gives weights whose sum at a node differs from 1 by"):
        made(name, body, farthest(body.vertices, 5))


def test_neural_mls_does_not_separate_control_points_of_one_group(body):
    near = np.argsort(np.linalg.norm(body.vertices - body.vertices[0], axis=1))[:6]
    far = np.argsort(np.linalg.norm(body.vertices - body.vertices[-1], axis=1))[:6]
    held, group = np.concatenate([near, far]), np.repeat([0, -1], 6)
    targets = body.vertices[held] + np.where(group[:, None] == 0, (0.1, 0.2, 0.0), 0)
    moved = PEERS["NeuralMLS"].prepare(body)(held, group)(targets)
    assert np.linalg.norm(moved[held] - targets, axis=1).max() < 0.02 * np.linalg.norm(np.ptp(body.vertices, axis=0))
    control = torch.from_numpy(body.vertices[held]).float()
    groups = (torch.arange(12), torch.from_numpy(group))
    apart, together = (neural_mls.trained(control, each)(control).softmax(dim=1).diagonal() for each in groups)
    assert together.mean() < 0.5 * apart.mean()


def test_neural_mls_reproduces_rigid_motions(body):
    held = farthest(body.vertices, 8)
    deform, turn = made("NeuralMLS", body, held), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(deform(body.vertices[held] @ turn.T), body.vertices @ turn.T, atol=1e-2)


@pytest.mark.slow
def test_a_shape_is_filled_and_every_step_is_timed(ball):
    pytest.importorskip("wildmeshing")
    handles = farthest(ball.vertices, 6)
    jobs = [Job(handles, np.arange(6), ball.vertices[handles] + move) for move in ((0, 0, 0), (0, 1, 0))]
    for done, move in zip(run(PEERS["biharmonic"], ball, jobs), (0, 1), strict=True):
        np.testing.assert_allclose(done.vertices, ball.vertices + (0, move, 0), atol=1e-6)
        assert set(done.seconds) == {"tetrahedra", "prepare", "bind", "pose"}


# --- a method of the user


def by_vertices(mesh, handles, targets):
    return mesh.vertices + (targets - mesh.vertices[handles])[0]


def by_weights(mesh, handles):
    return np.stack([np.linspace(0, 1, len(mesh.vertices))] * len(handles), axis=1)


def by_nothing(mesh, handles):
    return mesh.vertices


@pytest.mark.parametrize("own", [by_vertices, by_weights])
def test_a_method_of_the_user_gives_vertices_or_weights(own, body):
    held = farthest(body.vertices, 3)
    targets = body.vertices[held] + [[0, 1, 0], [0, 0, 0], [0, 0, 0]]
    moved = given(f"{__name__}:{own.__name__}").prepare(body)(held, np.arange(3))(targets)
    share = np.ones(len(moved)) if own is by_vertices else np.linspace(0, 1, len(moved))
    np.testing.assert_allclose(moved, body.vertices + share[:, None] * (0, 1, 0), atol=1e-12)


def test_weights_count_a_handle_once_however_many_vertices_are_near_it(body):
    held, group = farthest(body.vertices, 5), np.array([0, 0, 0, -1, -1])
    targets = body.vertices[held] + (group == 0)[:, None] * (0, 1, 0)
    moved = given(f"{__name__}:by_weights").prepare(body)(held, group)(targets)
    share = np.linspace(0, 1, len(moved))
    np.testing.assert_allclose(moved, body.vertices + share[:, None] * (0, 1, 0), atol=1e-12)


def test_a_method_of_the_user_must_return_an_array_of_the_right_shape(body):
    with pytest.raises(PeerError, match=r"by_nothing must return an array of the shape \(\d+, 5\), got"):
        given(f"{__name__}:by_nothing").prepare(body)(farthest(body.vertices, 5), np.arange(5))


@pytest.mark.parametrize("name", ["nothing", "no_such_module:f", "numpy:no_such_function", "numpy:ones_like"])
def test_a_method_that_does_not_exist_or_has_other_arguments_is_refused(name):
    with pytest.raises(ValueError, match="--method"):
        given(name)


def test_a_method_is_refused_on_a_page_without_comparison(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["fig7", "--method", "numpy:add"])
    assert "--method can only be given for a page that compares methods: fig8" in capsys.readouterr().err


def test_a_method_of_the_user_has_a_row_with_all_measures(monkeypatch, small, tmp_path):
    def pulled(_, case, *__):
        return SimpleNamespace(vertices=case.shape.mesh.vertices)

    monkeypatch.setattr(comparisons, "pulled", lambda *given, **_: pulled(*given))
    monkeypatch.setattr(comparisons, "drawn", lambda _, case, *__, **___: (case.shape.name, []))
    monkeypatch.setitem(CASES, "pulls", {"chair": CASES["pulls"]["chair"]})
    job = JOBS["fig14"]
    context = Context(quick=True, methods={"mine": given(f"{__name__}:by_vertices")})
    [row] = [each for each in job(context).rows if each["method"] == "mine"]
    assert {"agreement %", "gap %", "asymmetry %", "area %", "angle °", "edge %", "volume %"} < set(row)
