"""Test the page of every figure and table on a small shape, and the methods that DFD is compared with."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
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
from bench.paper import comparisons, features, figures, page, resolution, subjects
from bench.paper.__main__ import main
from bench.paper.comparisons import FEW, MANY, case_of, constraints, farthest
from bench.paper.figures import CANNOT, FIGURES, PAGES
from bench.paper.page import Claim, write
from bench.paper.peers import PEERS, biharmonic
from bench.paper.peers.biharmonic import direct, small_system
from bench.paper.peers.peer import MOST_FACES, Body, Done, Job, PeerError, Tetrahedra, run, tetrahedra
from bench.paper.subjects import NAMES, Context
from bench.quality.shapes import SAMPLES

igl = pytest.importorskip("igl")

neural_mls = importlib.import_module("bench.paper.peers.neural_mls")

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def ball() -> dfd.Mesh:
    made = trimesh.creation.icosphere(subdivisions=3)
    return dfd.Mesh(made.vertices, made.faces)


# --- pages


@pytest.fixture
def small(monkeypatch) -> None:
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
    monkeypatch.setattr("dfd.editing.influence.handle_weights.symmetry_planes", lambda field, mesh: [])
    for module in (comparisons, resolution):
        monkeypatch.setattr(module, "run", lambda peer, mesh, jobs, **_: [Done(mesh.vertices, seconds) for _ in jobs])


@pytest.fixture(scope="module")
def context(tmp_path_factory) -> Context:
    encoder = save_tiny_encoder(tmp_path_factory.mktemp("encoder"))
    return Context(quick=True, encoder=encoder)


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_every_page_is_made(name, context, tmp_path, small, one_thread):
    text = write(PAGES[name], FIGURES[name], name, tmp_path, context).read_text("utf-8")
    for claim in FIGURES[name]:
        assert f"| {claim.measured} | {claim.paper} | " in text
        assert re.search(
            rf"^- (Not decided: .* {re.escape(claim.measured)}|{re.escape(claim.measured)}: .* our bound)",
            text,
            re.MULTILINE,
        )
    for link in re.findall(r"\]\((.+?)\)", text):
        assert (tmp_path / link).stat().st_size > 1000


def test_the_posed_robot_is_no_mirror_image():
    resting, posed = dfd.samples.robot().mesh.vertices, subjects.posed_robot().vertices
    moved = np.linalg.norm(posed - resting, axis=1) > 1e-6
    assert 0.02 < moved.mean() < 0.3
    assert (resting[moved, 0] > 0).all()
    assert posed[moved, 1].mean() > resting[moved, 1].mean() + 0.05


def test_every_figure_of_the_paper_has_a_page_or_a_reason():
    names = [f"fig{number}" for number in range(1, 25)] + ["table1", "table2", "table3"]
    assert sorted(names) == sorted([*PAGES, *CANNOT])
    assert set(PAGES) == set(FIGURES)


def test_the_reference_says_of_every_page_what_it_shows_and_what_the_paper_has():
    text = (ROOT / "docs" / "reference" / "paper.md").read_text("utf-8")
    for name, make in PAGES.items():
        claims = "; ".join(dict.fromkeys(claim.paper for claim in FIGURES[name]))
        assert f"| `{name}` | {make.__doc__.splitlines()[0].rstrip('.')} | {claims} |" in text
    assert all(f"`{name}`" in text for name in CANNOT)
    assert all(f"`{each.prepare.__module__}.{each.prepare.__name__}`" in text for each in PEERS.values())


@pytest.mark.parametrize(
    "fact",
    [
        "37 people: DFD-T 82 %",
        "23 people: DFD 64 %",
        "D₀, the transform",
        "2601.12527v1",
        "views=100,",
        "another encoder",
    ],
)
def test_the_reference_names_what_our_pages_lack(fact: str) -> None:
    assert fact in (ROOT / "docs" / "reference" / "paper.md").read_text("utf-8")


def test_the_recorded_numbers_are_those_of_the_claims_and_their_bounds():
    text = (ROOT / "docs" / "reference" / "paper.md").read_text("utf-8").partition("## Our numbers")[2]
    lines = [line for line in text.splitlines() if line.startswith(("| `fig", "| `table"))]
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines if line.count(" | ") == 5]
    assert len(rows) > 10
    for name, kind, measured, number, bound, verdict in rows:
        assert kind in ("full", "quick")
        [claim] = [each for each in FIGURES[name.strip("`")] if each.measured == measured]
        assert bound == (f"at least {claim.least:g}" if np.isfinite(claim.least) else f"at most {claim.most:g}")
        within = claim.least <= float(number) <= claim.most
        assert verdict == ("yes" if within else f"no: {claim.cause.rstrip('.')}")
        assert within or claim.cause


def test_a_verdict_follows_from_the_number_and_gives_the_cause():
    claim = Claim("1", "ratio", len, most=2, cause="two cores.")
    assert claim.verdict(2.0, quick=False) == "ratio: 2, within our bound (at most 2)."
    assert claim.verdict(2.1, quick=False) == "ratio: 2.1, outside our bound (at most 2). Cause: two cores."
    assert "Not decided" in claim.verdict(float("nan"), quick=False)


class AnyRow(dict):
    """A table row with a random number in each column that it does not contain. Numbers grow with the faces."""

    def __missing__(self, name: str) -> float:
        random, means = self["random"], self["means"]
        mean = means.setdefault(name, random.uniform(-3, 3))
        of_kind = means.setdefault(("of", self["kind"]), random.normal(0, self["spread"]))
        grown = means.setdefault("growth", random.uniform(0, 1.5)) * np.log10(dict.get(self, "faces", 1) / 1000)
        self[name] = 10 ** float(mean + of_kind + max(grown, 0) + random.normal(0, self["spread"]) / 4)
        return self[name]

    def get(self, name, default=None):
        return self[name]


def random_tables() -> Iterator[list[AnyRow]]:
    """Yield tables with a row for each method, variant and size that a claim may name.

    Rows draw a number when a claim first asks for it. So each test makes its own tables: then its result does not
    depend on the tests before it.
    """
    for seed in range(100):
        yield random_table(np.random.default_rng(seed))


def random_table(random: np.random.Generator) -> list[AnyRow]:
    variants = ["free", "fixed", "λ = 0", "λ = 32", "leg", features.VERTICES_ALONE, *features.KINDS]
    methods = ["ARAP", "biharmonic", "BBW", "NeuralMLS", "OptCtrlPoints", "DFD, forward pass", "DFD, features kept"]
    common = {"random": random, "spread": random.uniform(0, 1), "means": {}, "shape": "a", "note": "", "nodes": 1}
    kinds = [{"preset": NAMES["paper"], "variant": each} for each in variants for _ in range(2)]
    largest = random.choice(resolution.FACES)
    kinds += [
        {"method": each, "faces": faces, **({"bind s": None} if faces > largest else {})}
        for each, faces in product((NAMES["paper"], *methods), resolution.FACES)
    ]
    kinds += [{"method": each, "variant": fixed} for each in (NAMES["paper"], *methods) for fixed in (FEW, MANY)]
    return [AnyRow(each, kind=each.get("method", each.get("variant")), **common) for each in kinds]


@pytest.mark.parametrize(("name", "claim"), [(name, each) for name, claims in FIGURES.items() for each in claims])
def test_every_verdict_can_be_either(name: str, claim: Claim) -> None:
    tables = [[row for row in rows if name != "fig10" or "faces" in row] for rows in random_tables()]
    verdicts = [claim.verdict(claim.number(rows), quick=False) for rows in tables]
    assert {word for word in ("within", "outside") for each in verdicts if f", {word} our bound" in each} == {
        "within",
        "outside",
    }


def test_distortions_are_compared_on_the_shapes_on_which_a_method_works() -> None:
    found = {"a": {NAMES["paper"]: 2, "ARAP": -1}, "b": {NAMES["paper"]: 50, "ARAP": None}}
    rows = [
        {"shape": shape, "method": method, "volume %": value, "note": "failed" if value is None else ""}
        for shape, values in found.items()
        for method, value in values.items()
    ]
    assert figures.against("volume %", "ARAP")(rows) == 2


def test_a_limit_of_faces_is_not_decided_on_meshes_below_it() -> None:
    rule = figures.most_faces("biharmonic")
    rows = [{"method": "biharmonic", "faces": faces, "bind s": 1.0} for faces in resolution.FACES[:3]]
    assert np.isnan(rule(rows))
    assert rule([*rows, {"method": NAMES["paper"], "faces": 10**6}]) == 1e5
    assert rule([*rows, {"method": "biharmonic", "faces": 10**6, "bind s": 1.0}]) == 1e6


@pytest.mark.parametrize(("count", "paper"), [(1, 1150), (10, 946), (100, 641)])
def test_the_numbers_of_the_paper_are_within_our_bound(count: int, paper: float) -> None:
    [claim] = [each for each in FIGURES["table3"] if each.paper.startswith(f"{paper:,} times")]
    assert f"{count} handle" in claim.measured
    assert "within" in claim.verdict(paper, quick=False)


@pytest.mark.parametrize("name", CANNOT)
def test_the_command_says_what_it_cannot_make(name, capsys):
    with pytest.raises(SystemExit, match="2"):
        main([name])
    assert f"cannot be made: {CANNOT[name]}"[:30] in capsys.readouterr().err


# --- peers


def block(*counts: int) -> Body:
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
def body() -> Body:
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


JOBS = list(product(("chair", "quadruped"), (0.0, comparisons.BALL)))  # jobs of Fig. 15, and of Fig. 8, 14 and 22


def job_of(shape: str, ball: float, monkeypatch: pytest.MonkeyPatch) -> tuple[dfd.Mesh, Job]:
    pytest.importorskip("wildmeshing")
    monkeypatch.delenv("DFD_MESHES", raising=False)
    case = case_of(Context().shape(shape).refined(), subjects.PULLS[shape])
    return case.shape.mesh, constraints(case, ball)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "ball"), JOBS)
@pytest.mark.parametrize("name", PEERS)
def test_a_move_of_all_moves_the_shape_in_the_jobs_of_the_figures(name, shape, ball, monkeypatch):
    mesh, job = job_of(shape, ball, monkeypatch)
    move = np.array([0.1, 0.2, 0.3])
    moved = run(PEERS[name], mesh, [replace(job, targets=mesh.vertices[job.held] + move)])[0].vertices
    most = 2e-3 if name == "ARAP" else 1e-4  # ARAP stops after 100 iterations
    assert float(np.abs(moved - mesh.vertices - move).max()) < most * mesh.diagonal


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "ball"), JOBS)
@pytest.mark.parametrize("prepare", [direct, small_system])
def test_coordinates_reproduce_affine_maps_in_the_jobs_of_the_figures(prepare, shape, ball, monkeypatch):
    mesh, job = job_of(shape, ball, monkeypatch)
    within = tetrahedra(mesh.vertices, mesh.faces.astype(np.int64), 900, MOST_FACES)
    handles = np.unique(within.nearest(mesh.vertices[job.held]))
    off = prepare(within)(handles) @ within.nodes[handles] - within.nodes
    assert float(np.abs(off).max()) < 1e-4 * mesh.diagonal
