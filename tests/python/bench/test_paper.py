"""The paper's comparisons on small sets in the layouts of APAP-Bench 3D and DeepMetaHandles."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from made_field import made_field
from PIL import Image

import dfd
from bench.paper import compare as methods
from bench.paper.__main__ import PAGES, main
from bench.paper.compare import compare, methods_of, solve
from bench.paper.context import Context, Shape, session
from bench.paper.handles import FIXED, USER, Case, find, read_apap, read_meta_handles
from bench.paper.peers.peer import PeerError
from dfd.mesh.normalization import normalization

MOVE = np.array([0.0, 0.5, 0.25])


@pytest.fixture(scope="module")
def ball() -> dfd.Mesh:
    made = trimesh.creation.icosphere(subdivisions=3)
    return dfd.Mesh(made.vertices, made.faces)


def field_of(mesh: dfd.Mesh) -> dfd.Field:
    center, scale = normalization(mesh)
    return made_field(6, width=32, layers=2, octaves=1, center=center, scale=scale)


def top(mesh: dfd.Mesh) -> int:
    return int(mesh.vertices[:, 1].argmax())


def bottom(mesh: dfd.Mesh) -> int:
    return int(mesh.vertices[:, 1].argmin())


def line(vertex: int, place: np.ndarray) -> str:
    return f"{vertex} " + " ".join(f"{each:.9g}" for each in place) + "\n"


def write_apap(folder: Path, mesh: dfd.Mesh, texts: str = ".") -> Path:
    (folder / texts).mkdir(parents=True)
    mesh.save(folder / "mesh.obj")
    (folder / texts / USER).write_text(line(top(mesh), mesh.vertices[top(mesh)] + MOVE))
    (folder / texts / FIXED).write_text("\n" + line(bottom(mesh), mesh.vertices[bottom(mesh)]))
    return folder


def write_meta(folder: Path, mesh: dfd.Mesh, basis: np.ndarray) -> np.ndarray:
    folder.mkdir(parents=True)
    mesh.save(folder / "manifold.obj")
    points = np.array([top(mesh), bottom(mesh), int(mesh.vertices[:, 0].argmax())])
    text = "".join("v " + " ".join(map(repr, map(float, mesh.vertices[point]))) + "\n" for point in points)
    (folder / "key_point_50.obj").write_text("# control points\n" + text)
    np.save(folder / "basis.npy", basis.astype(np.float32))
    return points


def test_apap_lines_are_vertices_of_the_file_and_where_they_go(tmp_path, ball):
    case = read_apap(write_apap(tmp_path / "ball", ball) / "mesh.obj", tmp_path / "ball")
    assert case.handles.tolist() == [top(ball)]
    assert case.fixed.tolist() == [bottom(ball)]
    assert case.held.tolist() == [top(ball), bottom(ball)]
    np.testing.assert_allclose(case.targets, [ball.vertices[top(ball)] + MOVE], atol=1e-6)
    np.testing.assert_allclose(case.held_to[1], ball.vertices[bottom(ball)], atol=1e-6)


def test_both_sides_of_a_seam_are_the_vertex_that_faces_name(tmp_path):
    folder = tmp_path / "seam"
    folder.mkdir()
    (folder / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\nf 3 4 5\n")
    (folder / USER).write_text("3 2 0 0\n1 2 0 0\n")
    (folder / FIXED).write_text("0 0 0 0\n0 0 0 0\n")
    case = read_apap(folder / "mesh.obj", folder)
    assert case.handles.tolist() == [1]
    np.testing.assert_array_equal(case.targets, [(2, 0, 0)])
    assert case.fixed.tolist() == [0]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        (USER, "", "must name at least one handle, got none"),
        (USER, "\n1 2 3\n", "line 2: must read 'vertex x y z', got '1 2 3'"),
        (USER, "1.5 0 0 0\n", "line 1: must read 'vertex x y z', got '1.5 0 0 0'"),
        (USER, "1 0 nan 0\n", "line 1: must read 'vertex x y z', got '1 0 nan 0'"),
        (USER, "642 0 0 0\n", "line 1: vertex must be one of 0 … 641, got 642"),
        (USER, "-1 0 0 0\n", "line 1: vertex must be one of 0 … 641, got -1"),
        (USER, "5 0 0 0\n6 0 0 0\n5 1 1 1\n", "line 3: vertex 5 must go to one place, but it is that of line 1"),
        (FIXED, "TOP 0 1 0\n", f"line 1: vertex TOP must go to one place, but it is a handle of {USER}"),
        (FIXED, "5 9 9 9\n", "the file is of another mesh or order of vertices"),
    ],
)
def test_what_does_not_fit_is_refused_by_file_and_line(tmp_path, ball, name, text, message):
    folder = write_apap(tmp_path / "ball", ball)
    (folder / name).write_text(text.replace("TOP", str(top(ball))))
    said = re.escape(message.replace("TOP", str(top(ball))))
    with pytest.raises(ValueError, match=f"^{re.escape(str(folder / name))}.*{said}"):
        read_apap(folder / "mesh.obj", folder)


def test_a_vertex_of_no_face_is_refused(tmp_path):
    folder = tmp_path / "loose"
    folder.mkdir()
    (folder / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 5 5 5\nf 1 2 3\n")
    (folder / USER).write_text("3 5 6 5\n")
    (folder / FIXED).write_text("")
    with pytest.raises(ValueError, match="line 1: vertex 3 must be a corner of a face, but no face of the mesh uses"):
        read_apap(folder / "mesh.obj", folder)


def test_all_layouts_are_found_and_others_are_not(tmp_path, ball):
    write_apap(tmp_path / "axe", ball, "keypoints/004")
    write_apap(tmp_path / "bear", ball)
    write_meta(tmp_path / "chair", ball, np.ones((1, 9)))
    (tmp_path / "lora").mkdir()
    assert [found.name for found in find(tmp_path)] == ["axe 004", "bear", "chair"]
    assert [found.name for found in find(tmp_path / "bear")] == ["bear"]
    with pytest.raises(ValueError, match=r"must hold folders with mesh\.obj and user_single_keypoints\.txt"):
        find(tmp_path / "lora")
    with pytest.raises(OSError, match="nowhere"):
        find(tmp_path / "nowhere")


def test_the_largest_offset_of_the_basis_is_taken(tmp_path, ball):
    basis = np.zeros((2, 3, 3))
    basis[0, 1] = 0.3, 0, 0
    basis[1, 2] = 0, 0.2, 0
    points = write_meta(tmp_path / "flat", ball, basis.reshape(2, 9))
    case = read_meta_handles(tmp_path / "flat")
    assert case.handles.tolist() == [points[1]]
    np.testing.assert_allclose(case.targets, [ball.vertices[points[1]] + basis[0, 1]], atol=1e-6)
    np.testing.assert_allclose(case.held_to - ball.vertices[case.held], basis[0], atol=1e-6)
    assert len(case.fixed) == 0
    write_meta(tmp_path / "ranged", ball, basis)
    np.save(tmp_path / "ranged" / "coef_range.npy", np.array([(-0.5, 1), (-2, 1)]))
    case = read_meta_handles(tmp_path / "ranged")
    assert case.handles.tolist() == [points[2]]
    np.testing.assert_allclose(case.targets, [ball.vertices[points[2]] - (0, 0.4, 0)], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("basis.npy", np.ones((2, 8)), r"basis\.npy must have shape \(B, 9\) or \(B, 3, 3\), got \(2, 8\)"),
        ("basis.npy", np.full((2, 9), np.inf), r"basis\.npy must be finite, got inf"),
        ("basis.npy", "1 2 3", r"basis\.npy must be an \.npy file of numbers"),
        ("coef_range.npy", np.ones((2, 2)), r"coef_range\.npy must have shape \(1, 2\), got \(2, 2\)"),
        ("w_mesh.npy", np.ones((4, 3)), r"w_mesh\.npy must have shape \(642, 3\), got \(4, 3\)"),
        ("key_point_50.obj", "v 0 1 0\nv 0 0\n", r"key_point_50\.obj, line 2: must read 'v x y z', got 'v 0 0'"),
        ("key_point_50.obj", "v 9 9 9\n", r"line 1: must lie at a vertex of manifold\.obj, got \(9, 9, 9\)"),
        ("key_point_50.obj", "f 1 2 3\n", "must hold control points as 'v x y z', got none"),
    ],
)
def test_what_does_not_fit_a_basis_is_refused(tmp_path, ball, name, content, message):
    write_meta(tmp_path / "chair", ball, np.ones((1, 9)))
    if isinstance(content, str):
        (tmp_path / "chair" / name).write_text(content)
    else:
        np.save(tmp_path / "chair" / name, content)
    with pytest.raises(ValueError, match=message):
        read_meta_handles(tmp_path / "chair")


def case_of(mesh: dfd.Mesh, held: list[int], moves: np.ndarray, **more) -> Case:
    vertices = np.array(held)
    to = mesh.vertices[vertices] + moves
    return Case(mesh, vertices[:1], to[:1], vertices[1:], vertices, to, **more)


def test_neighbors_go_along_with_the_nearest_point(ball):
    case = case_of(ball, [top(ball), bottom(ball)], np.array([MOVE, 0 * MOVE]))
    job = methods.constraints(case, 0.1)
    held, to = job.held, job.targets
    distance = np.linalg.norm(ball.vertices - ball.vertices[top(ball)], axis=1)
    near = np.flatnonzero(
        (distance <= 0.2) | (np.linalg.norm(ball.vertices - ball.vertices[bottom(ball)], axis=1) <= 0.2)
    )
    assert held.tolist() == near.tolist()
    assert len(held) > 4
    upper = ball.vertices[held, 1] > 0
    np.testing.assert_allclose(to - ball.vertices[held], np.where(upper[:, None], MOVE, 0), atol=1e-12)
    assert job.group.tolist() == np.where(upper, 0, -1).tolist()
    assert methods.constraints(case, 0.0).held.tolist() == sorted(case.held)
    dense = case_of(ball, [top(ball), bottom(ball)], np.array([MOVE, 0 * MOVE]), dense=True)
    assert methods.constraints(dense, 0.1).held.tolist() == sorted(case.held)


def test_vertices_of_no_face_do_not_stop_the_peers(ball):
    pytest.importorskip("igl")
    mesh = dfd.Mesh(np.concatenate([ball.vertices, [(9.0, 9, 9)]]), ball.faces)
    moved = methods.deform("ARAP", case_of(mesh, [top(ball), bottom(ball)], MOVE), 0.01)
    np.testing.assert_allclose(moved[:-1], ball.vertices + MOVE, atol=1e-5)
    np.testing.assert_array_equal(moved[-1], mesh.vertices[-1])


def test_coordinates_of_the_set_are_used(ball):
    corners = [top(ball), bottom(ball)]
    weights = np.stack([0.5 + ball.vertices[:, 1] / 2, 0.5 - ball.vertices[:, 1] / 2], axis=1)
    case = case_of(ball, corners, np.array([MOVE, 0 * MOVE]), coordinates=weights)
    moved = methods.deform("biharmonic", case, 0.01)
    np.testing.assert_allclose(moved, ball.vertices + weights[:, :1] * MOVE, atol=1e-12)


def test_a_piece_without_a_point_is_told(ball):
    both = dfd.Mesh(
        np.concatenate([ball.vertices, ball.vertices + 5]),
        np.concatenate([ball.faces, ball.faces + len(ball.vertices)]),
    )
    with pytest.raises(PeerError, match="on every one of the 2 components"):
        methods.deform("ARAP", case_of(both, [top(ball), bottom(ball)], MOVE), 0.01)


@pytest.fixture
def context(monkeypatch) -> Context:
    """A context whose fields are made from nothing."""
    monkeypatch.setattr(Context, "field", lambda self, shape, preset: field_of(shape.mesh))
    return Context()


@pytest.mark.parametrize("preset", ["paper", "default"])
def test_dfd_reaches_the_handle_and_holds_the_fixed_points(ball, context, preset):
    case = case_of(ball, [top(ball), bottom(ball)], np.array([MOVE, 0 * MOVE]))
    before = ball.vertices.copy()
    moved = solve(context, case, preset)
    np.testing.assert_allclose(moved[case.handles], case.targets, atol=1e-6)
    held = solve(context, case, preset, fixed=True)
    np.testing.assert_allclose(held[case.fixed], ball.vertices[case.fixed], atol=1e-6)
    np.testing.assert_array_equal(ball.vertices, before)


def test_the_papers_session_is_that_of_its_equations(ball):
    """Eq. 1 and 4 to 6 by `dfd.bind` and `dfd.pose` alone."""
    field = field_of(ball)
    handle = {"at": top(ball), "translation": MOVE}
    deformer = session(ball, field, "paper", [handle], fixed=[bottom(ball)])
    weights = dfd.bind(field.features(ball), [top(ball)], fixed=[bottom(ball)])
    np.testing.assert_allclose(deformer.weights, weights, atol=1e-6)
    transform = np.concatenate([np.eye(3), MOVE[:, None]], axis=1)[None]
    np.testing.assert_allclose(
        deformer.vertices, dfd.pose(ball.vertices, weights, transform, overlap="paper"), atol=1e-6
    )


def test_a_method_that_fails_stops_no_other(ball, monkeypatch):
    weights = np.full((len(ball.vertices), 1), 1.0)
    case = case_of(ball, [top(ball)], MOVE, coordinates=weights)

    def none(self: Context, shape: Shape, preset: str) -> dfd.Field:
        raise OSError("no such\nencoder")

    monkeypatch.setattr(Context, "field", none)
    monkeypatch.setattr(methods, "COMPARED", ("ARAP", "biharmonic"))
    rows = {row.method: row for row in compare("ball", case, methods_of(Context(), case, 0.0))}
    assert list(rows) == ["paper preset", "dfd default", "ARAP", "biharmonic"]
    assert rows["paper preset"].note == "no such encoder"
    assert rows["paper preset"].values == [None] * 6
    assert rows["biharmonic"].missing == pytest.approx(0, abs=1e-9)
    assert rows["biharmonic"].metrics.area == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
def test_the_command_writes_a_table_and_a_page(tmp_path, ball, context, capsys, monkeypatch):
    pytest.importorskip("igl")
    monkeypatch.setattr(methods, "COMPARED", ("ARAP",))
    write_apap(tmp_path / "set" / "ball", ball)
    broken = write_apap(tmp_path / "set" / "wrong", ball)
    (broken / USER).write_text("first\n")
    assert main(["handles", str(tmp_path / "set"), "-o", str(tmp_path / "out")]) == 1
    with (tmp_path / "out" / "handles_1.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    names = ["paper preset", "dfd default"]
    fixed = [f"{name}, fixed points" for name in names]
    assert [row["method"] for row in rows] == [names[0], fixed[0], names[1], fixed[1], "ARAP", ""]
    for row in rows[:5]:
        # The paper's fixed points take from a handle.
        assert float(row["handle off %"]) < (100 if row["method"] == fixed[0] else 1e-3)
        assert float(row["area %"]) > 0
        assert row["note"] == ""
    assert "line 1: must read 'vertex x y z', got 'first'" in rows[5]["note"]
    told = (tmp_path / "out" / "handles.md").read_text("utf-8")
    assert "| ball | ARAP |" in told
    assert "got 'first'" in told
    numbers = json.loads((tmp_path / "out" / "handles.json").read_text("utf-8"))
    assert [row["method"] for row in numbers["tables"]["Results"]][:2] == [names[0], fixed[0]]
    with Image.open(tmp_path / "out" / "handles_1.png") as page:
        assert page.width > 4 * 320
        assert page.height > 320
    assert "handles.md" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["handles", "FOLDER"], "must hold folders with"),
        (["handles"], "give the folder of the set"),
        (["handles", "nowhere"], "nowhere is not a folder"),
        (["handles", "FOLDER", "--ball", "-1"], "--ball: invalid"),
        (["fig0"], "invalid choice: 'fig0'"),
        ([], "NAME must be one of"),
    ],
)
def test_a_wrong_command_line_is_refused(tmp_path, capsys, words, message):
    with pytest.raises(SystemExit) as raised:
        main([word.replace("FOLDER", str(tmp_path)) for word in words])
    assert raised.value.code == 2
    assert message in capsys.readouterr().err


def test_all_pages_are_listed(capsys):
    assert main(["--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(PAGES)
