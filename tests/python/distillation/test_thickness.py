"""Test thickness: known chords, bands on transformed copies, and numbers of threads."""

from types import SimpleNamespace

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import dfd
from dfd.distillation import thickness
from dfd.distillation.targets import PointTargets
from dfd.distillation.thickness import BANDS, RAYS, thickness_bands, thicknesses
from dfd.geometry.topology import face_components, sample_surface
from dfd.views.raycast import Scene

# Cosines between the rays of a point and its normal, from the middle of the cone outwards.
COSINES = 1 - (np.arange(RAYS) + 0.5) / RAYS * (1 - np.cos(thickness.CONE))
MEDIAN = (RAYS - 1) // 2
IDENTITY = np.eye(3)


def drawn(mesh, count=500):
    """Return vertices and faces of `mesh`, and random points with the face of each."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)
    points, face = sample_surface(vertices, faces, count, np.random.default_rng(0))
    return vertices, faces, points, face


def flipped(faces, chosen):
    return np.where(chosen[:, None], faces[:, [0, 2, 1]], faces)


def thick(vertices, faces, points, face, piece=None):
    return thicknesses(Scene(vertices, faces), vertices[faces[face]], points, piece)


def targets_of(mesh, turn=IDENTITY, count=3000):
    """Return the arguments of `thickness_bands` for `mesh`, rotated by `turn` after its points were drawn."""
    drawn_on = mesh.vertices / mesh.diagonal
    points, face = sample_surface(drawn_on, mesh.faces, count, np.random.default_rng(0))
    turned = drawn_on @ turn.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    vertices, points = (((at - (low + high) / 2) / (np.max(high - low) / 2)) for at in (turned, points @ turn.T))
    component = face_components(mesh.faces)
    piece = component[face] if component.max() > 0 else None
    views = SimpleNamespace(vertices=vertices.astype(np.float32), faces=mesh.faces, scene=None)
    return views, PointTargets(points.astype(np.float32), np.ones((count, 1), np.float32), None, piece, face=face)


def test_a_sphere_is_as_thick_as_its_chords():
    found = thick(*drawn(trimesh.creation.icosphere(subdivisions=5, radius=0.5)))
    np.testing.assert_allclose(found, np.sort(COSINES)[MEDIAN], rtol=0.03)  # a chord has the length 2 r cos(angle)


def test_a_slab_is_as_thick_as_its_median_ray():
    vertices, faces, points, face = drawn(trimesh.creation.box((1.8, 0.1, 1.8)), 2000)
    found = thick(vertices, faces, points, face)
    middle = np.abs(points[:, [0, 2]]).max(axis=1) < 0.6
    np.testing.assert_allclose(found[middle], 0.1 / np.sort(COSINES)[::-1][MEDIAN], rtol=0.01)


def test_bands_increase_with_thickness_and_do_not_change_with_rotation_and_scale():
    sample = dfd.samples.quadruped(4000)
    views, targets = targets_of(sample.mesh)
    before = targets.points.copy()
    bands = thickness_bands(views, targets)
    assert (bands.shape, bands.dtype) == ((3000, BANDS), np.float32)
    assert bands.min() >= 0
    assert bands.max() <= 1
    np.testing.assert_array_equal(targets.points, before)
    part = sample.labels[sample.mesh.faces[targets.face, 0]]
    band = {name: bands[part == number].mean(axis=0).argmax() for number, name in enumerate(sample.parts)}
    assert band["leg"] < band["body"]
    assert band["ear"] < band["body"]
    turn = Rotation.from_euler("xyz", (0.7, -0.4, 1.9)).as_matrix()
    copy = thickness_bands(*targets_of(dfd.Mesh(7 * sample.mesh.vertices, sample.mesh.faces), turn))
    # A ray that grazes an edge can pass it on either side.
    assert np.abs(copy - bands).mean() < 2e-3
    assert np.quantile(np.abs(copy - bands), 0.99) < 0.05


def test_the_number_of_threads_does_not_change_bands():
    views, targets = targets_of(dfd.samples.chair(4000).mesh)
    found = []
    for count in (1, 3):
        dfd.set_num_threads(count)
        found.append(thickness_bands(views, targets))
    np.testing.assert_array_equal(*found)
