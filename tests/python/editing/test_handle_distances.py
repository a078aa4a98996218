"""Test which geodesic distances a session computes."""

import numpy as np

import dfd


def test_locality_is_each_handle_s_own(paper, geodesics_of):
    geodesics = geodesics_of(paper)
    paper.add(5, locality=3.0)
    paper.add(900)
    wanted = dfd.bind(paper.features, [5, 900], geodesic=geodesics.distances([5, 900]), locality=[3.0, 0.0])
    np.testing.assert_array_equal(paper.weights, wanted)


def test_a_point_s_distances_start_at_the_nearest_vertex(deformer, geodesics, mesh):
    deformer.add(mesh.vertices[70] + 1e-4, locality=1.0)
    _ = deformer.weights
    assert geodesics.asked == [[70]]


def test_locality_of_a_symmetric_edit_starts_at_both_mirror_images(deformer, geodesics, bound, mesh):
    vertex = int(mesh.vertices[:, 0].argmax())
    mirrored = int(np.linalg.norm(mesh.vertices - mesh.vertices[vertex] * [-1, 1, 1], axis=1).argmin())
    deformer.add(vertex, locality=3.0, reach=1.0, falloff="linear", follow="none")
    deformer.add(5, reach=1.0, follow="none")
    _ = deformer.weights
    deformer.set_symmetry("x")
    both = geodesics.distances([vertex, mirrored]).min(axis=0)
    wanted = dfd.bind(deformer.features, [vertex], geodesic=both[None], locality=3.0)
    np.testing.assert_array_equal(deformer.weights[:, :1], wanted)
    assert bound == [1, 1, 1]


def test_in_the_paper_s_preset_distances_start_at_the_handle_alone(paper, geodesics_of):
    geodesics = geodesics_of(paper)
    paper.set_symmetry("x")
    paper.add(5, locality=3.0)
    _ = paper.weights
    assert geodesics.asked == [[5]]
