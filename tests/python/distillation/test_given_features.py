"""Features that come from outside: fitted where they are, blended over the surface, refused where they are odd."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import dfd
from dfd import Mesh
from dfd.distillation.given_features import GivenFeatures

QUIET = {"device": "cpu", "progress": False}


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))


def smooth(points: np.ndarray) -> np.ndarray:
    """Features that a field can follow: (N, 4), of many lengths."""
    x, y, z = (np.asarray(points) * 3).T
    return np.stack([np.sin(x), np.cos(y), np.sin(z), np.ones_like(x)], axis=1) * (2 + np.cos(x + y))[:, None]


def unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def test_the_field_gives_the_vertices_their_features(mesh: Mesh) -> None:
    rows = smooth(mesh.vertices)
    before = rows.copy()
    field = dfd.distill(mesh, features=rows, steps=120, batch=1024, learning_rate=1e-2, **QUIET)
    errors = np.linalg.norm(field.features(mesh) - unit(rows), axis=1)
    assert errors.mean() < 0.05
    np.testing.assert_array_equal(rows, before)
    assert field.settings["features"] == "vertices"
    assert len(field.settings["losses"]) == 120


def test_features_of_points_are_fitted_at_the_points(mesh: Mesh) -> None:
    low, high = mesh.bounds
    points = np.random.default_rng(0).uniform(low, high, (3000, 3))
    settings = {"steps": 120, "batch": 1024, "learning_rate": 1e-2, **QUIET}
    field = dfd.distill(mesh, features=(points, smooth(points)), **settings)
    assert np.linalg.norm(field(points) - unit(smooth(points)), axis=1).mean() < 0.06
    assert field.settings["features"] == "points"


def drawn(mesh: Mesh, rows: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points in mesh units, and their targets."""
    given = GivenFeatures(mesh, rows)
    points, targets = given.draw(count, torch.Generator().manual_seed(0))
    return points.numpy() / given.scale + given.center, targets.numpy()


def test_points_are_drawn_evenly_by_area_and_blended() -> None:
    # A square of two triangles, one of 20 slivers without area, and a third triangle of a quarter of the square.
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [3, 0, 0], [3.5, 0, 0], [3, 1, 0]])
    faces = [[0, 1, 2], [0, 2, 3], *[[0, 1, 1]] * 20, [4, 5, 6]]
    # Linear in the position, so that a blend of three corners is the value at the point.
    rows = np.concatenate([vertices[:, :2], np.ones((7, 1))], axis=1)
    normalized = unit(rows)
    points, targets = drawn(Mesh(vertices, faces), normalized, 20_000)
    left = points[:, 0] <= 1
    assert left.mean() == pytest.approx(0.8, abs=0.01)
    np.testing.assert_allclose(points[left].mean(axis=0), [0.5, 0.5, 0], atol=0.01)
    np.testing.assert_allclose(points[~left].mean(axis=0), [3 + 1 / 6, 1 / 3, 0], atol=0.01)
    np.testing.assert_allclose(np.linalg.norm(targets, axis=1), 1, atol=1e-5)
    corners = np.array([[4, 5, 6]])
    shares = np.linalg.solve(
        np.concatenate([vertices[corners[0], :2].T, np.ones((1, 3))]),
        np.concatenate([points[~left][:, :2].T, np.ones((1, (~left).sum()))]),
    ).T
    np.testing.assert_allclose(targets[~left], unit(shares @ normalized[corners[0]]), atol=1e-4)


def with_row(rows: np.ndarray, row: int, value: float) -> np.ndarray:
    rows = rows.copy()
    rows[row] = value
    return rows


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda rows: rows[:-1],
            r"`features` must have shape \(2004, D\), .* got \(2003, 4\); features of other points",
        ),
        (
            lambda rows: np.concatenate([rows, rows]),
            r"got \(4008, 4\); these may be those of its faces, which have as many",
        ),
        (lambda rows: rows[:, 0], r"`features` must have shape \(V, D\), got \(2004,\)"),
        (lambda rows: rows[:, :0], r"`features` must have at least one column, got \(2004, 0\)"),
        (lambda rows: with_row(rows, 5, np.nan), r"`features` must be finite, got nan at \[5, 0\]"),
        (lambda rows: with_row(rows, 7, 0), "`features` must have rows with a direction, got only zeros in row 7"),
        (lambda rows: with_row(rows, 7, 1e300), "`features` has values too large for float32"),
        (lambda rows: "rows", "`features` must be a numeric array, got 'rows'"),
        (lambda rows: (rows[:, :3], rows[1:]), "a row for each of the points, got 2003 rows for 2004 points"),
        (lambda rows: (rows[:, :2], rows), r"`points` must have shape \(N, 3\), got \(2004, 2\)"),
        (lambda rows: (rows[:0, :3], rows[:0]), "got 0 rows for 0 points"),
        (lambda rows: (with_row(rows[:, :3], 2, np.inf), rows), r"`points` must be finite, got inf at \[2, 0\]"),
    ],
)
def test_odd_features_are_named(mesh: Mesh, change: object, message: str) -> None:
    with pytest.raises(ValueError, match=f"distill: {message}" if message.startswith("`") else message):
        dfd.distill(mesh, features=change(smooth(mesh.vertices)), steps=1, batch=8, **QUIET)  # type: ignore[operator]


def test_a_mesh_without_area_is_refused() -> None:
    mesh = Mesh([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    with pytest.raises(ValueError, match="`mesh` must have a face with an area"):
        dfd.distill(mesh, features=np.eye(3), steps=1, **QUIET)
