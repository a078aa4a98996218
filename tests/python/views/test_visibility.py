"""What no camera sees, on shapes of which it is known."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE
from numpy.typing import NDArray

import dfd
from dfd.mesh.mesh import Mesh
from dfd.views.visibility import Unseen, unseen

Arrays = tuple[NDArray[np.float64], NDArray[np.int64]]


def grid(count: int) -> Arrays:
    """A square of `count` × `count` pairs of triangles, coordinates in [0, 1]."""
    line = np.linspace(0, 1, count + 1)
    points = np.stack(np.meshgrid(line, line, indexing="ij"), -1).reshape(-1, 2)
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    first = np.stack([corner, corner + count + 1, corner + count + 2], 1)
    second = np.stack([corner, corner + count + 2, corner + 1], 1)
    return points, np.concatenate([first, second])


def together(*shapes: Arrays) -> Mesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in shapes)])
    faces = [faces + start for (_, faces), start in zip(shapes, starts, strict=False)]
    return Mesh(np.concatenate([vertices for vertices, _ in shapes]), np.concatenate(faces))


@pytest.mark.parametrize("fine", [1, 20])
def test_a_plane_is_seen_from_both_sides(fine: int) -> None:
    points, faces = grid(fine)
    for axis in range(3):
        assert unseen(Mesh(np.insert(points, axis, 0.0, axis=1), faces)) == Unseen(24, 0.0, 0, 1)


def test_an_open_bowl_is_seen_whole() -> None:
    points, faces = grid(24)
    around, down = 2 * np.pi * points[:, 0], np.pi / 2 * points[:, 1]
    bowl = np.column_stack([np.cos(around) * np.sin(down), np.sin(around) * np.sin(down), -np.cos(down)])
    assert unseen(Mesh(bowl, faces)) == Unseen(24, 0.0, 0, 1)


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e200])
def test_a_box_in_a_box_is_not_seen(scale: float) -> None:
    found = unseen(together((CORNERS * scale, CUBE), ((CORNERS / 2 + 0.25) * scale, CUBE)))
    assert (found.components, found.component_count) == (1, 2)
    assert found.area == pytest.approx(1 / 5, abs=1e-3)  # a quarter of the outer one's area


def test_with_a_window_it_is_seen_in_part() -> None:
    inner = (CORNERS / 2 + 0.25, CUBE)
    found = unseen(together((CORNERS, CUBE[1:]), inner))
    assert found.components == 0
    assert 0 < found.area < 0.2


def test_faces_without_area_and_unused_vertices_do_no_harm() -> None:
    vertices = np.vstack([CORNERS, [(0, 0, 2), (90, 0, 0)]])
    bad = [(0, 0, 1), (3, 3, 3), (0, 1, 8), CUBE[0], CUBE[1][[2, 1, 0]]]
    mesh = Mesh(vertices[:9], np.vstack([CUBE, bad]))
    assert unseen(mesh).components == 0
    assert unseen(Mesh(vertices, CUBE)) == Unseen(24, 0.0, 0, 1)


@pytest.mark.parametrize("corners", [np.ones((3, 3)), [[0, 0, 0], [1, 0, 0], [2, 0, 0]]])
def test_where_there_is_no_area_there_is_nothing_to_see(corners: NDArray[np.float64]) -> None:
    assert unseen(Mesh(corners, [[0, 1, 2]])) == Unseen(24, 1.0, 0, 0)


def test_any_number_of_threads_gives_the_same() -> None:
    shape = dfd.samples.chair(20000).mesh
    found = []
    for count in (1, 3):
        dfd.set_num_threads(count)
        found.append(unseen(shape))
    assert found[0] == found[1]
