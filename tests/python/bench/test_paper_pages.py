"""The pages of the paper's figures on a small made shape, and the numbers that they have."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from tiny_encoder import save_tiny_encoder

import dfd
from bench.paper import compare, comparisons, drawing, resolution
from bench.paper import context as shared
from bench.paper.__main__ import PAGES, make
from bench.paper.context import Context, Shape
from bench.paper.drawing import silhouettes
from bench.paper.encoders import correlation
from bench.paper.features import in_box_of
from bench.paper.measures import defects, gap, roughness, subdivided
from bench.paper.peers.peer import Done
from bench.paper.report import Page, Section, Table, write
from bench.quality.measures import area_fractions
from dfd.distillation.settings import DistillSettings

TINY = {"views": 4, "resolution": 32, "steps": 5, "batch": 64, "up": "file"}
ALONE = [name for name in PAGES if name != "handles"]  # without a folder of handles


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """One file with a shape of two pieces."""
    made = tmp_path_factory.mktemp("meshes")
    body = trimesh.creation.icosphere(subdivisions=2)
    body.vertices *= (0.6, 1, 0.8)
    foot = trimesh.creation.box((0.5, 0.2, 0.5)).subdivide().apply_translation((0, -1.05, 0.2))
    trimesh.util.concatenate([body, foot]).export(made / "thing.ply")
    return made


@pytest.fixture(scope="module")
def context(folder, tmp_path_factory) -> Context:
    encoder = save_tiny_encoder(tmp_path_factory.mktemp("encoder"))
    return Context(folder=folder, quick=True, encoder=encoder, settings=TINY)


@pytest.fixture
def small(monkeypatch) -> None:
    """Small pictures of coarse shapes; other methods, and the search for planes, have tests of their own."""
    seconds = dict.fromkeys(("tetrahedra", "prepare", "bind", "pose"), 0.5)
    monkeypatch.setattr(drawing, "RESOLUTION", 48)
    monkeypatch.setattr(shared, "LONGEST_EDGE", 0.2)
    monkeypatch.setattr(resolution, "FACES", (300, 900))
    monkeypatch.setattr("dfd.editing.influence.instance_weights.symmetry_planes", lambda field, mesh: [])
    for module in (compare, resolution):
        monkeypatch.setattr(module, "run", lambda make, mesh, jobs, **_: [Done(mesh.vertices, seconds) for _ in jobs])


@pytest.mark.slow
@pytest.mark.parametrize("name", ALONE)
def test_every_page_is_made(name, context, tmp_path, small, one_thread):
    page = make(name, context)
    if name.startswith("fig"):
        assert page.title.startswith(f"Fig. {int(re.sub('[^0-9]', '', name))}:")
    text = write(page, name, tmp_path, context.notes(), {"presets": context.used}).read_text("utf-8")
    assert "thing" in text or name.startswith("study")
    assert "**paper preset**" in text
    assert "--quick" in text
    for link in re.findall(r"\]\((.+?)\)", text):
        assert (tmp_path / link).stat().st_size > 1000
    numbers = json.loads((tmp_path / f"{name}.json").read_text("utf-8"))
    assert set(numbers["presets"]) == {"paper preset", "dfd default"}
    assert any(numbers["tables"].values()) or name.startswith("study")
    assert "NaN" not in (tmp_path / f"{name}.json").read_text("utf-8")


def test_meshes_are_looked_for_in_the_folder_then_in_dfd_meshes_then_among_samples(folder, tmp_path, monkeypatch):
    known = {"cow": 1, "quadruped": 2, "*": 3}
    monkeypatch.delenv("DFD_MESHES", raising=False)
    assert [(shape.name, case) for shape, case in Context().cases(known, (5, 5))] == [("quadruped", 2)]
    assert [(shape.name, case) for shape, case in Context(folder=folder).cases(known, (5, 5))] == [("thing", 3)]
    trimesh.creation.box().export(tmp_path / "cow.obj")
    monkeypatch.setenv("DFD_MESHES", str(tmp_path))
    assert [(shape.name, case) for shape, case in Context().cases(known, (1, 1))] == [("cow", 1)]
    assert Context(folder=folder).shape("cow", "quadruped").name == "cow"


@pytest.mark.parametrize("more", [{}, {"steps": 7}, {"supervision": "vertex", "steps": 7}])
def test_a_fit_has_one_length(more):
    for preset in ("paper", "default"):
        settings = DistillSettings(**Context(quick=True).distill_settings(preset, **more))
        assert (settings.steps, settings.epochs).count(None) == 1


def test_places_are_given_along_the_box_and_large_faces_are_refined():
    box = trimesh.creation.box((1, 2, 3))
    shape = Shape("box", dfd.Mesh(box.vertices, box.faces))
    np.testing.assert_allclose(shape.mesh.vertices[shape.at((0, 1, 0.9))], (-0.5, 1, 1.5))
    fine = shape.refined().mesh
    corners = fine.vertices[fine.faces]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() <= 0.03 * fine.diagonal + 1e-9
    assert fine.vertices.max(axis=0) == pytest.approx((0.5, 1, 1.5))


def without(faces: np.ndarray, *gone: np.ndarray) -> np.ndarray:
    return np.delete(faces, np.concatenate(gone), axis=0)


def test_holes_are_the_rings_of_open_edges():
    ball = trimesh.creation.icosphere(subdivisions=3)
    assert defects(dfd.Mesh(ball.vertices, ball.faces)).holes == 0
    top = np.flatnonzero((ball.faces == ball.vertices[:, 1].argmax()).any(axis=1))
    side = np.flatnonzero((ball.faces == ball.vertices[:, 0].argmax()).any(axis=1))
    one, two = (dfd.Mesh(ball.vertices, without(ball.faces, *gone)) for gone in ([top], [top, side]))
    assert defects(one).holes == 1
    assert len(defects(one).boundary) == len(top)
    assert defects(two).holes == 2
    assert defects(two).non_manifold == 0


def test_edges_and_vertices_that_are_no_manifold_are_counted():
    box = trimesh.creation.box()
    beside, corner = box.copy(), box.copy()
    beside.apply_translation((1, 1, 0))  # along an edge
    corner.apply_translation((1, 1, 1))  # at a vertex
    for other, count in ((beside, 1), (corner, 1), (box.copy().apply_translation((3, 0, 0)), 0)):
        both = trimesh.util.concatenate([box, other])
        assert defects(dfd.Mesh(both.vertices, both.faces)).non_manifold == count


def test_subdividing_keeps_holes():
    ball = trimesh.creation.icosphere(subdivisions=2)
    open_ball = dfd.Mesh(ball.vertices, ball.faces[5:])
    finer = subdivided(open_ball, 1)
    assert len(finer.faces) == 4 * len(open_ball.faces)
    assert defects(finer).holes == defects(open_ball).holes == 1


def test_roughness_is_the_mean_slope():
    grid = trimesh.creation.box((1, 1, 1)).subdivide()
    mesh = dfd.Mesh(grid.vertices, grid.faces)
    # x has slope 1 on four of six sides and 0 on the two across it.
    assert roughness(mesh, 3 * mesh.vertices[:, 0]) == pytest.approx(3 * 4 / 6 * mesh.diagonal)
    assert roughness(mesh, np.ones(len(mesh.vertices))) == 0
    assert area_fractions(mesh).sum() == pytest.approx(1)


def test_correlation_counts_areas():
    values = np.array([0.0, 1.0, 5.0])
    areas = np.array([0.5, 0.5, 0.0])
    assert correlation(values, 2 * values + 1, areas) == pytest.approx(1)
    assert correlation(values, np.array([1.0, 0.0, 5.0]), areas) == pytest.approx(-1)


def test_a_gap_opens_only_where_parts_move_apart():
    box = trimesh.creation.box()
    both = trimesh.util.concatenate([box, box.copy().apply_translation((1.001, 0, 0))])
    mesh = dfd.Mesh(both.vertices, both.faces)
    assert gap(mesh, mesh.vertices + 3) == pytest.approx(0, abs=1e-12)
    apart = mesh.vertices + (mesh.vertices[:, :1] > 0.5005) * (0.25, 0, 0)
    assert gap(mesh, apart) == pytest.approx(0.25)
    assert gap(dfd.Mesh(box.vertices, box.faces), box.vertices) is None


def test_another_shape_is_scaled_into_the_box():
    box = trimesh.creation.box()
    mesh = dfd.Mesh(box.vertices, box.faces)
    other = dfd.Mesh(box.vertices * (1, 2, 3) + 5, box.faces)
    np.testing.assert_allclose(in_box_of(mesh, other), other.vertices)


def test_silhouettes_are_blue_before_and_green_after():
    ball = trimesh.creation.icosphere(subdivisions=2)
    mesh = dfd.Mesh(ball.vertices, ball.faces)
    moved = mesh.vertices + (3.0, 0, 0)
    where = {"azimuth": 0.0, "elevation": 0.0, "frame": [mesh.vertices, moved], "resolution": 64}
    image = silhouettes(mesh, moved, where).astype(int)
    inked = (image < 250).any(axis=2)
    left, right = (image[:, side][inked[:, side]].mean(axis=0) for side in (slice(0, 30), slice(34, 64)))
    assert left[2] > left[1]
    assert right[1] > right[2]


def test_a_page_is_written_with_its_numbers(tmp_path):
    table = Table(["name", "count", "share"], [["a|b", 1234, 0.123456], ["c", None, None]])
    page = Page("Title", "Look here.", [Section("Part", "Text.", table=table)], {"more": np.float32(2)})
    told = write(page, "made", tmp_path, ["a note"], {"quick": False}).read_text("utf-8")
    assert "| a/b | 1,234 | 0.123 |" in told
    assert "- a note" in told
    assert (tmp_path / "made_1.csv").read_text("utf-8") == "name,count,share\na|b,1234,0.123456\nc,,\n"
    numbers = json.loads((tmp_path / "made.json").read_text("utf-8"))
    assert numbers["tables"]["Part"][0] == {"name": "a|b", "count": 1234, "share": 0.123456}
    assert numbers["more"] == 2


@pytest.mark.slow
def test_the_key_of_a_study_tells_which_option_is_which_and_the_sheet_does_not(context, tmp_path, small, monkeypatch):
    monkeypatch.setattr(comparisons, "STUDY_PEERS", ())
    monkeypatch.setattr(comparisons, "SEED", 3)
    told = write(make("study1", context), "study1", tmp_path, [], {}).read_text("utf-8")
    key = json.loads((tmp_path / "study1_key.json").read_text("utf-8"))
    options = {name: what for name, what in key["question 1"].items() if name != "shape"}
    kinds = {f"{preset}, {kind}" for preset in ("paper preset", "dfd default") for kind in ("translation", "affine")}
    assert set(options.values()) == kinds
    assert list(options) == [f"option {number}" for number in range(1, 5)]
    assert key["seed"] == 3
    for name in kinds:
        assert name not in told
        assert name not in (tmp_path / "study1.json").read_text("utf-8")
    assert json.loads(make("study1", context).files["study1_key.json"]) == key
