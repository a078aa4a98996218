"""Test counts on meshes with known defects, and the order of faces by position."""

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE

from dfd.geometry.topology import by_position, inspect, sample_surface, sorted_corners
from dfd.mesh.mesh import Mesh


def test_a_cube_is_one_closed_component():
    found = inspect(Mesh(CORNERS * 2, CUBE))
    assert (found.vertex_count, found.face_count, found.components) == (8, 12, 1)
    assert (found.boundary_edges, found.non_manifold_edges) == (0, 0)
    assert (found.degenerate_faces, found.duplicate_faces, found.unreferenced_vertices) == (0, 0, 0)
    assert found.opposed_edges == 0
    turned = np.vstack([CUBE[:1, ::-1], CUBE[1:]])
    assert inspect(Mesh(CORNERS * 2, turned)).opposed_edges == 3
    assert found.extents == (2, 2, 2)
    assert (found.parts, found.materials, found.textures) == (1, 0, 0)


def test_positions_that_coincide_count_as_one_vertex_of_the_surface():
    soup = Mesh(CORNERS[CUBE].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    found = inspect(soup)
    assert (found.components, found.boundary_edges, found.vertex_count) == (1, 0, 36)


def test_faces_without_area_and_repeated_faces_are_counted_and_do_no_harm():
    vertices = np.vstack([CORNERS, [(0, 0, 2), (9, 9, 9)]])
    bad = [(0, 0, 1), (3, 3, 3), (0, 1, 8), CUBE[0], CUBE[1][[2, 1, 0]], CUBE[1][[1, 2, 0]]]
    found = inspect(Mesh(vertices, np.vstack([CUBE, bad])))
    assert found.degenerate_faces == 3
    assert found.duplicate_faces == 3
    assert found.unreferenced_vertices == 1
    assert found.components == 1


@pytest.mark.parametrize("offset", [0.0, 1e3, -1e6])
def test_a_small_face_far_from_the_origin_has_area(offset):
    vertices = np.array([(0, 0, 0), (1e-3, 0, 0), (0, 1e-3, 0), (2e-3, 0, 0)]) + offset
    found = inspect(Mesh(vertices, [(0, 1, 2), (0, 1, 3)]))
    assert found.degenerate_faces == 1


def test_counts_agree_with_trimesh_on_a_torn_sphere():
    sphere = trimesh.creation.icosphere(3)
    kept = np.random.default_rng(1).random(len(sphere.faces)) < 0.7
    torn = trimesh.Trimesh(sphere.vertices, sphere.faces[kept], process=False)
    found = inspect(Mesh(torn.vertices, torn.faces))
    counts = np.bincount(torn.edges_unique_inverse)
    assert found.boundary_edges == (counts == 1).sum()
    links = trimesh.graph.connected_component_labels(torn.edges, node_count=len(torn.vertices))
    assert found.components == len(np.unique(links[torn.faces]))


RANDOM = np.random.default_rng(3)
# Small faces in a unit cube. Two faces of a star share a center, and two others differ in their corners only there.
PLACES = RANDOM.random((40, 1, 3)) + 0.01 * RANDOM.standard_normal((40, 3, 3))
STAR = np.array([(0, 0, 1), (1, 0, 0), (0, 1, 0)]) / 3 + 0.2
TRIANGLES = np.concatenate([PLACES, [STAR, 2 * STAR.mean(axis=0) - STAR]])


def in_order(vertices, faces):
    """Return the corners (N, 3, 3) of the faces in their order, each with its corners in order."""
    return vertices[sorted_corners(vertices, faces)[by_position(vertices, faces)]]


def shuffled(vertices, faces):
    """Return a mesh with vertices, faces and corners in another order."""
    order = RANDOM.permutation(len(vertices))
    turns = (RANDOM.integers(3, size=(len(faces), 1)) + np.arange(3)) % 3
    return vertices[order], np.take_along_axis(np.argsort(order)[faces], turns, axis=1)[RANDOM.permutation(len(faces))]


@pytest.mark.parametrize(
    "change",
    [
        shuffled,
        lambda vertices, faces: (vertices * 1e-3, faces),
        lambda vertices, faces: (vertices + 1000.0, faces),
        lambda vertices, faces: shuffled(vertices, np.concatenate([faces, faces[::-1, [1, 2, 0]], faces])),
        lambda vertices, faces: (np.concatenate([vertices, vertices]), np.concatenate([faces + len(vertices), faces])),
        lambda vertices, faces: (np.concatenate([vertices, RANDOM.random((500, 3)) * 100]), faces),
    ],
    ids=["another order", "smaller", "shifted", "doubled faces", "doubled surface", "unused vertices"],
)
def test_only_positions_decide_the_order_of_faces(change):
    vertices, faces = TRIANGLES.reshape(-1, 3), np.arange(TRIANGLES.size // 3).reshape(-1, 3)
    wanted, changed = in_order(vertices, faces), in_order(*change(vertices, faces))
    assert len(wanted) == len(faces)
    moved, size = changed - changed.min(axis=(0, 1)), np.ptp(changed, axis=(0, 1)).max()
    np.testing.assert_allclose(
        moved / size, (wanted - wanted.min(axis=(0, 1))) / np.ptp(wanted, axis=(0, 1)).max(), atol=1e-9
    )


def test_two_sides_of_a_sheet_are_one_face_whose_samples_do_not_depend_on_the_side():
    vertices, faces = TRIANGLES.reshape(-1, 3), np.arange(TRIANGLES.size // 3, dtype=np.int32).reshape(-1, 3)
    both = np.concatenate([faces, faces[:, ::-1]])
    wanted = in_order(vertices, faces)
    for sheet in (both, both[::-1]):
        np.testing.assert_array_equal(in_order(*shuffled(vertices, sheet)), wanted)
        samples = sample_surface(vertices, sheet, 500, np.random.default_rng(0))[0]
        np.testing.assert_allclose(samples, sample_surface(vertices, faces, 500, np.random.default_rng(0))[0])


def test_faces_follow_a_curve_that_fills_one_cell_of_a_grid_after_the_other():
    centers = (np.stack(np.meshgrid(*3 * [np.arange(8)]), axis=-1).reshape(-1, 3) + 0.5)[RANDOM.permutation(512)]
    vertices = np.concatenate([(centers[:, None] + 0.1 * np.eye(3)).reshape(-1, 3), [(0, 0, 0), (8, 8, 8)]])
    faces = np.concatenate([np.arange(1536).reshape(-1, 3), [(1536, 1536, 1536), (1537, 1537, 1537)]])
    order = by_position(vertices, faces)
    bits = np.floor(centers[order[(order < 512)]]).astype(int)[:, ::-1, None] >> [2, 1, 0] & 1  # (512, z y x, levels)
    codes = bits.transpose(0, 2, 1).reshape(512, 9) @ (1 << np.arange(9)[::-1])
    np.testing.assert_array_equal(codes, np.arange(512))


def test_corners_are_sorted_by_x_then_y_then_z():
    vertices = np.stack(np.meshgrid(*3 * [np.arange(3.0)]), axis=-1).reshape(-1, 3)[RANDOM.permutation(27)]
    faces = np.array([RANDOM.permutation(27)[:3] for _ in range(200)], np.int32)
    for before, after in zip(faces.tolist(), sorted_corners(vertices, faces).tolist(), strict=True):
        assert after == sorted(before, key=lambda corner: tuple(vertices[corner]))
