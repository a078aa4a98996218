"""Test that generated shapes are closed, exactly symmetric and labelled, with the requested number of faces."""

import numpy as np
import pytest

from dfd import samples
from dfd.geometry.topology import inspect
from dfd.mesh.mesh import Mesh
from dfd.samples.implicit import Primitive, Shape, ellipsoid
from dfd.samples.polygonize import polygonize

MAKERS = [samples.chair, samples.quadruped, samples.robot]
INSTANCES = {  # the number of parts of each kind
    samples.chair: {"seat": 1, "back": 1, "leg": 4},
    samples.quadruped: {"body": 1, "neck": 1, "head": 1, "ear": 2, "horn": 2, "leg": 4, "hoof": 4, "tail": 1},
    samples.robot: {"torso": 1, "head": 1, "arm": 2, "hand": 2, "leg": 2, "foot": 2},
}


@pytest.fixture(scope="module", params=MAKERS, ids=lambda maker: maker.__name__)
def made(request):
    return request.param, request.param(8000)


def test_a_sample_is_one_closed_manifold(made):
    found = inspect(made[1].mesh)
    assert (found.components, found.boundary_edges, found.non_manifold_edges) == (1, 0, 0)
    assert (found.degenerate_faces, found.duplicate_faces, found.unreferenced_vertices) == (0, 0, 0)
    corners = made[1].mesh.vertices[made[1].mesh.faces]
    assert np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0  # faces point outward


def test_a_sample_is_its_own_mirror_image(made):
    sample = made[1]
    vertices = sample.mesh.vertices
    place = {tuple(row): i for i, row in enumerate((vertices + 0.0).tolist())}
    image = np.array([place[tuple(row)] for row in (vertices * [-1, 1, 1] + 0.0).tolist()])
    assert np.array_equal(sample.labels[image], sample.labels)
    faces = {frozenset(face) for face in sample.mesh.faces.tolist()}
    assert {frozenset(face) for face in image[sample.mesh.faces].tolist()} == faces
    paired = np.isin(sample.labels, [sample.parts.index(part) for part in sample.parts if INSTANCES[made[0]][part] > 1])
    beside = paired & (vertices[:, 0] != 0)
    assert np.all(sample.instances[image[beside]] != sample.instances[beside])


def test_every_part_is_there_as_often_as_it_should(made):
    maker, sample = made
    assert sample.labels.shape == sample.instances.shape == (len(sample.mesh.vertices),)
    assert set(sample.parts) == set(INSTANCES[maker])
    for part, count in INSTANCES[maker].items():
        vertices = sample.vertices_of(part)
        assert np.unique(sample.instances[vertices]).tolist() == list(range(count)), part
        for instance in range(count):
            assert len(sample.vertices_of(part, instance)) > 20
            across = sample.mesh.vertices[sample.vertices_of(part, instance), 0].mean()
            assert abs(across) < 1e-12 if count == 1 else across * (1 if instance % 2 == 0 else -1) > 0.03


def test_a_sample_stands_on_the_floor_and_is_about_one_high(made):
    low, high = made[1].mesh.bounds
    assert low[1] == pytest.approx(0, abs=0.02)
    assert 0.9 < high[1] < 1.2


@pytest.mark.parametrize("faces", [4000, 20_000, 70_000])
def test_the_number_of_faces_is_nearly_the_one_asked_for(faces):
    sample = samples.chair(faces)
    assert len(sample.mesh.faces) == pytest.approx(faces, rel=0.15)


def test_samples_are_the_same_every_time():
    assert samples.quadruped(5000).mesh.content_hash == samples.quadruped(5000).mesh.content_hash


@pytest.mark.parametrize("faces", [0, -5, 3999, 5000.5, True, 10**15, "many", float("nan"), None])
def test_bad_face_counts_are_refused(faces):
    with pytest.raises(ValueError, match="samples.robot: `faces` must be"):
        samples.robot(faces)


def test_an_ellipsoid_has_its_volume_and_surface():
    shape = Shape([Primitive("egg", ellipsoid((0, 0, 0), (0.3, 0.4, 0.5)))])
    vertices, faces = polygonize(shape, (-0.5, -0.5, -0.6), (0.5, 0.5, 0.6), 10_000)
    assert np.abs(np.linalg.norm(vertices / [0.3, 0.4, 0.5], axis=1) - 1).max() < 1e-4
    corners = vertices[faces]
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 0.3 * 0.4 * 0.5, rel=2e-3)
    assert inspect(Mesh(vertices, faces)).boundary_edges == 0
