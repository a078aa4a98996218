"""Test the comparison of corresponding vertices with landmarks, and the distance of two cuts."""

from unittest import mock

import numpy as np
import pytest
from made_field import field_of

import dfd
from bench.quality.landmarks import judged, landmark_shapes
from bench.quality.people import rand_distance


def test_a_turned_copy_has_the_same_landmarks(tmp_path):
    (tmp_path / "Chair").mkdir()
    sample = dfd.samples.chair(4_000).mesh
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    meshes = [sample, dfd.Mesh(sample.vertices @ turn.T, sample.faces)]
    landmarks = np.linspace(0, len(sample.vertices) - 1, 9).astype(int)
    for number, mesh in enumerate(meshes):
        mesh.save(tmp_path / "Chair" / f"{number}.off")
        lines = (f"{vertex} {' '.join(map(str, mesh.vertices[vertex]))}\n" for vertex in landmarks)
        (tmp_path / "Chair" / f"{number}.vts").write_text("".join(lines))
    (tmp_path / "Chair" / "counterparts.info").write_text("0 1\n2\n")
    first, second = landmark_shapes(tmp_path)
    np.testing.assert_array_equal(first.landmarks, landmarks)
    assert first.mirrored[:3].tolist() == [1, 0, 2]
    rows = field_of(first.mesh)(first.mesh.vertices)
    fields = [dfd.VertexField(each.mesh, rows) for each in (first, second)]
    with mock.patch.object(dfd, "distill", lambda mesh, **_: dfd.VertexField(mesh, rows)):
        numbers = judged(first, fields[0])
    assert numbers["error"] < 0.05
    assert numbers["near"] == numbers["either side"] == 1
    assert numbers["nearest: near"] > 0.9


def test_a_folder_without_landmarks_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"landmarks: there is no CATEGORY/N\.vts"):
        list(landmark_shapes(tmp_path))


def test_the_distance_of_cuts_is_the_fraction_of_pairs_on_which_they_disagree():
    one, other = np.array([0, 0, 1, 1]), np.array([0, 1, 1, 1])
    assert rand_distance(one, other) == pytest.approx(3 / 6)
    assert rand_distance(one, one) == 0
    assert rand_distance(one, 7 - one) == 0
