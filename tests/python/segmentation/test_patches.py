"""Test how places are divided into patches."""

import numpy as np
import trimesh
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

import dfd
from dfd.segmentation.patches import Patches, _pieces
from dfd.segmentation.seeds import Mirror, nearest_seed, orbits_of_patches, symmetric


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
    patch, seed, owned = _pieces(of_seed, things, area)
    assert seed.tolist() == [0, 1, -1, -1, -1]
    assert owned[:, 0].tolist() == [7, 6, 5, 5, 8]  # the largest patch of a seed keeps it
    assert patch.tolist() == [2, 2, 0, 3, 1, 1, 4]
    monkeypatch.setattr("dfd.segmentation.patches.MOST", 3)
    patch, seed, owned = _pieces(of_seed, things, area)
    assert seed.tolist() == [0, 1, -1]
    assert patch.tolist() == [2, 2, 0, 1, 1, 1, 1]


def test_mirror_images_without_seeds_have_an_orbit_of_their_own():
    """The patches 3 and 4 are mirror images in the plane x = 0, and patch 5 has none."""
    center = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (2, 1, 0), (-2.01, 1, 0), (3, 1, 0)], float)
    mirrors = [Mirror(np.array([1.0, 0, 0]), 0.0)]
    found = orbits_of_patches(np.array([0, 0, 1]), np.array([0, 1, 2, -1, -1, -1]), center, 0.1, mirrors)
    assert found.tolist() == [0, 0, 1, 2, 2, 3]
    found = orbits_of_patches(np.array([0, 0, 1]), np.array([0, 1, 2, -1, -1, -1]), center, 0.02, mirrors)
    assert found.tolist() == [0, 0, 1, 2, 3, 4]


def test_places_that_are_mirror_images_belong_to_seeds_that_are_mirror_images():
    """The places 0 and 1, and 2 and 3, are mirror images in the plane x = 0. Place 4 is the image of none."""
    center = np.array([(1, 0, 0), (-1, 0, 0), (2, 0, 0), (-2, 0, 0), (-3, 0.5, 0), (0, 0, 0)], float)
    mirror, seeds = Mirror(np.array([1.0, 0, 0]), 0.0), center[[2, 3, 5]]
    found = symmetric(np.array([0, 2, 0, 1, 1, 2]), cKDTree(center), seeds, [mirror])
    assert found.tolist() == [0, 1, 0, 1, 1, 2]
    # Without an exact mirror image of its seed, a place keeps its patch.
    found = symmetric(
        np.array([0, 2, 0, 1, 1, 2]), cKDTree(center), seeds + [(0.1, 0, 0), (0, 0, 0), (0, 0, 0)], [mirror]
    )
    assert found.tolist() == [0, 2, 0, 1, 1, 2]


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
