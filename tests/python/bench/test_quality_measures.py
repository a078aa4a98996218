"""The quality bench's measures on cases computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from bench.quality.baselines import PeerError, biharmonic, euclidean, geodesic, in_child, rounds
from bench.quality.evaluate import Draw, judge
from bench.quality.measures import (
    average_precision,
    difference,
    dirichlet_energy,
    draw_handles,
    handle_precision,
    mirror_image,
    part_precision,
    spread,
)
from bench.quality.shapes import Shape
from dfd import Geodesics, Mesh, samples

SQUARE = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
HALVES = np.array([(0, 1, 2), (0, 2, 3)])


@pytest.mark.parametrize(
    ("relevant", "expected"),
    [((1, 1, 0, 0), 1.0), ((0, 0, 1, 1), (1 / 3 + 2 / 4) / 2), ((1, 0, 1, 0), (1 + 2 / 3) / 2), ((0, 1, 0, 0), 1 / 2)],
)
def test_average_precision_is_the_mean_of_the_precision_at_every_hit(relevant, expected):
    scores = np.array([0.9, 0.7, 0.4, 0.1])
    assert average_precision(scores, np.array(relevant, bool)) == pytest.approx(expected)


def test_average_precision_does_not_depend_on_the_order_of_equal_scores():
    scores = np.array([1.0, 0, 0, 0])
    # one of three hits on top, the two others somewhere among three ties: 1/3 · 1 + 2/3 · 3/4
    for relevant in ((1, 1, 1, 0), (1, 0, 1, 1), (1, 1, 0, 1)):
        assert average_precision(scores, np.array(relevant, bool)) == pytest.approx(1 / 3 + 2 / 3 * 3 / 4)


def test_average_precision_of_constant_scores_is_the_share_of_hits():
    assert average_precision(np.zeros(8), np.arange(8) < 3) == pytest.approx(3 / 8)


def test_precision_leaves_out_the_handle_and_vertices_without_a_part():
    labels = np.array([0, 0, 1, 1, -1, -1])
    column = np.array([1.0, 0.5, 0.6, 0.1, 0.9, 0.8])
    # besides itself, handle 0 has one vertex of its kind, ranked second of three that count
    assert handle_precision(column[:, None], labels, np.array([0])) == pytest.approx([1 / 2])
    column[4:] = 0
    assert handle_precision(column[:, None], labels, np.array([0])) == pytest.approx([1 / 2])


def test_part_precision_is_a_mean_per_part_and_skips_parts_of_one_vertex():
    labels = np.array([0, 0, 0, 1, 1, 2])
    first = np.array([1.0, 0.9, 0.8, 0.1, 0.1, 0.1])
    second = np.array([0.9, 0.2, 1.0, 0.9, 0.9, 0.9])  # handle 2: one of its kind among the first four, one last
    third = np.array([0.1, 0.1, 0.1, 1.0, 0.9, 0.1])
    weights = np.stack([first, second, third, np.ones(6)], axis=1)
    found = part_precision(weights, labels, np.array([0, 2, 3, 5]))
    assert found == {0: pytest.approx((1 + (1 / 4 + 2 / 5) / 2) / 2), 1: pytest.approx(1)}


def test_spread_compares_the_kind_of_part_with_the_rest():
    labels = np.array([0, 0, 1, 1, -1])
    weights = np.array([[1.0], [0.5], [0.25], [0.0], [1.0]])
    ratio, moving = spread(weights, labels, np.array([0]))
    assert ratio == pytest.approx(0.75 / 0.125)
    assert moving == pytest.approx(3 / 4)  # of the four vertices that have a part


def test_spread_over_a_single_part_has_no_ratio():
    ratio, moving = spread(np.ones((3, 1)), np.zeros(3, int), np.array([0]))
    assert np.isnan(ratio)
    assert moving == 1


def test_handles_are_drawn_in_every_part_and_again_for_the_same_seed():
    labels = np.repeat([0, 1, 2, -1], [10, 2, 5, 7])
    handles = draw_handles(labels, 4, seed=3)
    assert np.bincount(labels[handles]).tolist() == [4, 2, 4]
    assert len(set(handles.tolist())) == len(handles)
    assert (handles == draw_handles(labels, 4, seed=3)).all()
    assert (handles != draw_handles(labels, 4, seed=4)).any()


def test_the_mirror_image_of_a_shape_that_stands_beside_the_origin():
    vertices = np.array([(4.0, 0, 0), (6, 0, 0), (5, 1, 0)])
    image, miss = mirror_image(vertices)
    assert image.tolist() == [[6, 0, 0], [4, 0, 0], [5, 1, 0]]
    assert miss.tolist() == [0, 0, 0]
    vertices[2, 0] = 5.5  # misses its image by 1 of 2
    assert mirror_image(vertices)[1] == pytest.approx([0, 0, 0.5])


def test_a_shape_may_be_its_mirror_image_where_its_triangles_are_not():
    chair = samples.chair(4000).mesh
    vertices = chair.vertices + [5, 0, 0]
    assert Shape("chair", Mesh(vertices, chair.faces)).is_its_mirror
    nearly = vertices + np.random.default_rng(0).uniform(-0.002, 0.002, vertices.shape)
    assert Shape("chair", Mesh(nearly, chair.faces)).is_its_mirror
    assert not Shape("chair", Mesh(vertices[:, [1, 0, 2]], chair.faces)).is_its_mirror  # lying on its side


def test_difference_is_relative_to_the_reference():
    assert difference(np.array([[0.5], [0.5]]), np.array([[1.0], [0.0]])) == pytest.approx(1)
    assert difference(np.ones((2, 2)), np.ones((2, 2))) == 0


@pytest.mark.parametrize("size", [1.0, 1000.0])
def test_dirichlet_energy_of_a_ramp_over_a_square_is_one_at_any_size(size):
    ramp = SQUARE[:, :1]
    steep = np.hstack([ramp, 3 * ramp])
    assert dirichlet_energy(ramp, size * SQUARE, HALVES) == pytest.approx(1)
    assert dirichlet_energy(steep, size * SQUARE, HALVES) == pytest.approx((1 + 9) / 2)
    assert dirichlet_energy(np.ones((4, 1)), size * SQUARE, HALVES) == pytest.approx(0, abs=1e-12)


def test_dirichlet_energy_passes_over_faces_without_area():
    faces = np.vstack([HALVES, [(0, 1, 1)]])
    assert dirichlet_energy(SQUARE[:, :1], SQUARE, faces) == pytest.approx(1)


def test_distances_as_weights_are_one_at_the_handle_and_zero_at_the_farthest():
    handles = np.array([0, 1])
    through_space = euclidean(SQUARE, handles)
    assert through_space[:, 0] == pytest.approx([1, 1 - np.sqrt(0.5), 0, 1 - np.sqrt(0.5)])
    along = geodesic(Geodesics(Mesh(SQUARE, HALVES)), handles)
    assert along.shape == (4, 2)
    assert [along[0, 0], along[1, 1]] == [1, 1]
    assert along.min(axis=0) == pytest.approx([0, 0], abs=1e-6)


def test_rounds_hold_one_handle_a_part():
    labels = np.array([0, 0, 0, 1, 1, 2])
    found = rounds(labels, np.array([0, 1, 2, 3, 4, 5]))
    assert [each.tolist() for each in found] == [[0, 3, 5], [1, 4], [2]]


def test_a_peer_that_dies_hangs_or_raises_is_reported():
    large = np.zeros(1_000_000)  # more than a pipe holds
    assert in_child(len, large) == 1_000_000
    with pytest.raises(PeerError, match=r"crashes \(exit code 3\)"):
        in_child(_leave, 3)
    with pytest.raises(PeerError, match=r"takes longer than 0\.2 s"):
        in_child(_sleep, seconds=0.2)
    with pytest.raises(PeerError, match="no solution"):
        in_child(_refuse)


def test_biharmonic_weights_are_one_at_their_handle_and_zero_at_those_of_other_parts():
    pytest.importorskip("igl")
    sample = samples.chair(4000)
    handles = draw_handles(sample.labels, 2)
    weights = biharmonic(sample.mesh, sample.labels, handles, bounded=False)
    first = rounds(sample.labels, handles)[0]
    assert weights[handles[first]][:, first] == pytest.approx(np.eye(len(first)), abs=1e-6)
    assert weights.min() >= 0
    assert weights.max() <= 1


def test_biharmonic_weights_need_a_handle_on_every_piece():
    two = Mesh(np.vstack([SQUARE, SQUARE + 5]), np.vstack([HALVES, HALVES + 4]))
    with pytest.raises(PeerError, match="every one of the 2 components"):
        biharmonic(two, np.zeros(8, int), np.array([0, 5]), bounded=False)


def test_a_verdict_holds_what_the_shape_allows():
    sample = samples.chair(4000)
    labelled = Shape("chair", sample.mesh, sample.labels, sample.parts)
    parts = (sample.labels[:, None] == sample.labels).astype(np.float32)
    perfect = judge(labelled, lambda handles: parts[:, handles], Draw(2, (0, 1)))
    assert perfect["precision"] == 1
    assert perfect["ratio"] > 1000
    assert "symmetry error" not in perfect
    bare = Shape("chair", sample.mesh)
    half = judge(bare, lambda handles: parts[:, handles], Draw(2, (0,)), mirrored=lambda handles: parts[:, handles] / 2)
    assert half == {"Dirichlet energy": half["Dirichlet energy"], "symmetry error": pytest.approx(0.5)}


def _leave(code):
    import os

    os._exit(code)


def _sleep():
    import time

    time.sleep(60)


def _refuse():
    raise ValueError("no solution\nand much more")
