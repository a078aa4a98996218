"""Test how places are divided into patches."""

import numpy as np
import pytest
import trimesh
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

import dfd
from dfd.segmentation.patches import Patches, _orbits, _pieces
from dfd.segmentation.seeds import COUNT, NEAR, divided, mirror_images, nearest_seed
from dfd.symmetry.plane import SymmetryPlane


def test_a_place_belongs_to_the_seed_that_is_nearest_along_the_surface():
    """The places 0 to 5 form a U, whose ends are near each other. There is no path to place 6."""
    center = np.array([(0, 3, 0), (0, 1, 0), (0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 3, 0), (0, 5, 0)], float)
    one = np.arange(5)
    lengths = np.linalg.norm(center[one] - center[one + 1], axis=1)
    graph = csr_array((lengths, (one, one + 1)), shape=(7, 7))
    np.testing.assert_array_equal(nearest_seed(graph + graph.T, np.array([2, 0]), center), [1, 0, 0, 0, 0, 0, 1])


def test_things_without_seeds_get_patches_of_their_own_until_there_are_too_many(monkeypatch):
    of_seed = np.array([0, 0, 0, 1, 1, 1, 1])
    things = np.array([[5], [5], [7], [5], [6], [6], [8]])
    area = np.array([1.0, 1, 3, 1, 2, 2, 1])
    patch, first, owned = _pieces(of_seed, things, area)
    assert first.tolist() == [2, 4, 0, 3, 6]
    assert owned[:, 0].tolist() == [7, 6, 5, 5, 8]  # the largest patch of a seed comes first
    assert patch.tolist() == [2, 2, 0, 3, 1, 1, 4]
    monkeypatch.setattr("dfd.segmentation.patches.MOST", 3)
    patch, first, owned = _pieces(of_seed, things, area)
    assert first.tolist() == [2, 4, 0]
    assert patch.tolist() == [2, 2, 0, 1, 1, 1, 1]


def test_patches_with_one_seed_and_mirrored_things_are_an_orbit_and_the_first_orbits_have_different_seeds():
    assert _orbits(np.array([(0, 5), (0, 6), (2, 5), (0, 5), (1, 6)])).tolist() == [0, 3, 2, 0, 1]


@pytest.mark.parametrize(("step", "crosses"), [(1.5, False), (0.6, True)])
def test_each_place_stands_for_its_mirror_image_above_the_plane(step, crosses):
    """Places along a line are mirror images in the plane x = 0, except those at x = 4 and x = −6. Neighbors are linked.

    The surface of the seed in the plane lies on both sides of it.
    """
    x = np.array([0.0, 0.9, 2, 4, -0.9, -2, -6])
    center = np.stack([x, 0 * x, 0 * x], axis=1) * step * NEAR * COUNT**-0.5
    order = np.argsort(x)
    graph = csr_array((np.diff(center[order, 0]), (order[:-1], order[1:])), shape=(7, 7))
    # Reflections in the second plane do not commute with those in the first one.
    planes = [SymmetryPlane((1.0, 0.0, 0.0), 0.0), SymmetryPlane((0.8, 0.6, 0.0), 0.0)]
    ((height, image),) = mirrors = mirror_images(planes, np.zeros(3), 1.0, cKDTree(center))
    assert height.tolist() == center[:, 0].tolist()
    assert image.tolist() == [0, 4, 5, -1, 1, 2, -1]
    stands_for, seed, side = divided(np.hstack([center, 0 * center]), graph + graph.T, mirrors)
    assert stands_for.tolist() == [0, 1, 2, 3, 1, 2, 6]
    assert seed[4:6].tolist() == seed[1:3].tolist()
    assert (seed[1] == seed[0]) == crosses
    assert side.tolist() == [0, 0, 0, 0, int(not crosses), 1, 0]


def test_components_objects_and_materials_are_the_kinds_of_things(tmp_path):
    """Two balls are one object. A third one has the material of a box beside it."""
    moved = trimesh.transformations.translation_matrix
    balls = [trimesh.creation.icosphere(2).apply_transform(moved((4 * x, 0, 0))) for x in range(3)]
    scene = trimesh.Scene()
    for name, mesh, material in (
        ("pair", trimesh.util.concatenate(balls[:2]), "steel"),
        ("ball", balls[2], "gold"),
        ("box", trimesh.creation.box().subdivide().apply_transform(moved((0, 9, 0))), "gold"),
    ):
        look = trimesh.visual.material.PBRMaterial(name=material)
        mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(mesh.vertices), 2)), material=look)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.export(tmp_path / "scene.glb")
    patches = Patches(dfd.load(tmp_path / "scene.glb"))
    ball = (patches.center @ (1, 0, 0) * patches.size / 4).round(0)
    box = patches.center[:, 1] * patches.size > 3
    ball -= ball[~box].min()
    expected = [np.where(box, 3, ball), np.where(box, 2, ball == 2), np.where(box, 1, ball == 2)]
    assert len(patches.things) == 3
    for found, wanted in zip(patches.things, expected, strict=True):
        pairs = {*zip(found.tolist(), wanted.tolist(), strict=True)}
        assert len(pairs) == len({*found.tolist()}) == len({*wanted.tolist()})


def test_places_and_patches_do_not_depend_on_the_unit():
    made = trimesh.creation.icosphere(3)
    vertices = made.vertices * (1, 1.3, 1.7)
    one, *others = (Patches(dfd.Mesh(unit * vertices, made.faces)) for unit in (1.0, 2.0**-30, 2.0**20))
    for other in others:
        np.testing.assert_array_equal(other.place, one.place)
        np.testing.assert_array_equal(other.of_vertex, one.of_vertex)
        np.testing.assert_allclose(other.area, one.area, atol=1e-9)
