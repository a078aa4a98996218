"""Test which candidate is the part, and which are the levels beside it, on made candidates."""

from unittest import mock

import numpy as np
import pytest
import trimesh

import dfd
from dfd.segmentation import choose
from dfd.segmentation.choose import LARGEST, STEP, Candidates, candidates, ladder, probabilities
from dfd.segmentation.parts import Parts
from dfd.segmentation.trees import SMALLEST

COUNT = 1000  # number of patches, all of one area
AREA = np.full(COUNT, 1 / COUNT)


def made(sizes, likely, *, things=(), starts=None, votes=None):
    """Return candidates of so many patches, from the patches `starts` on, with probabilities in proportion `likely`.

    `things` are the indices of those that are things of the file.
    """
    number = np.arange(COUNT)
    first = np.zeros(len(sizes), int) if starts is None else np.asarray(starts)
    regions = (number >= first[:, None]) & (number < (first + sizes)[:, None])
    cues = np.zeros((len(sizes), 5))
    cues[:, 0] = np.log(likely)
    each = np.ones(len(sizes), np.int64) if votes is None else np.array(votes)
    return Candidates(regions, np.arange(len(sizes)), cues, each, np.isin(np.arange(len(sizes)), things), True)


@pytest.fixture(autouse=True)
def first_cue_alone():
    with mock.patch.object(choose, "_weights", return_value=np.eye(5)[0]):
        yield


def test_a_region_of_several_trees_counts_as_often():
    np.testing.assert_allclose(probabilities(made([100, 200, 300], [1, 2, 5])), [1 / 8, 2 / 8, 5 / 8])
    np.testing.assert_allclose(probabilities(made([100, 200, 300], [1, 2, 5], votes=[3, 1, 1])), [0.3, 0.2, 0.5])


def test_overlaps_are_shares_of_the_union():
    area = np.linspace(1, 2, COUNT) / np.linspace(1, 2, COUNT).sum()
    found = made([100, 300, 200], [1, 1, 1], starts=[0, 0, 200])
    one, two, both = (area[slice(*ends)].sum() for ends in ((0, 100), (0, 300), (200, 300)))
    wanted = np.eye(3)
    wanted[0, 1] = wanted[1, 0] = one / two
    wanted[1, 2] = wanted[2, 1] = both / area[:400].sum()
    np.testing.assert_allclose(found.overlaps(area), wanted)


def test_level_0_has_the_largest_expected_overlap():
    """The likeliest candidate is small, and the three others resemble each other."""
    found = made([100, 400, 500, 600], [0.34, 0.2, 0.24, 0.22])
    assert ladder(found, AREA) == ([0, 2], 1)
    assert ladder(made([100, 400, 500, 600], [0.9, 0.03, 0.04, 0.03]), AREA)[1] == 0


@pytest.mark.parametrize(("size", "is_part"), [(124, True), (126, False)])
def test_a_thing_of_nearly_the_same_size_is_the_part(size, is_part):
    found = made([100, size, 900], [0.8, 0.1, 0.1], things=[1])
    levels, middle = ladder(found, AREA)
    assert levels[middle] == (1 if is_part else 0)
    # Without the thing, the part is the likeliest candidate.
    levels, middle = ladder(made([100, size, 900], [0.8, 0.1, 0.1]), AREA)
    assert levels[middle] == 0


def test_neighboring_levels_differ_by_a_quarter_in_size():
    assert STEP == 1.25
    assert ladder(made([80, 81, 100, 124, 125], [1, 1, 9, 1, 1]), AREA) == ([0, 2, 4], 1)
    assert ladder(made([81, 100, 124], [1, 9, 1]), AREA) == ([1], 0)


def test_the_nearest_things_are_the_next_levels():
    sizes, likely = [20, 40, 60, 100, 150, 300, 600], [1, 9, 9, 90, 9, 1, 1]
    assert ladder(made(sizes, likely), AREA) == ([0, 1, 3, 4, 5, 6], 2)
    levels, middle = ladder(made(sizes, likely, things=[0, 2, 5, 6]), AREA)
    assert (levels[middle - 1], levels[middle], levels[middle + 1]) == (2, 3, 5)
    assert levels == [0, 1, 2, 3, 5, 6]


def test_a_further_level_adds_most_to_the_expected_overlap_and_is_nested():
    """Of two larger candidates, the likelier one is next. What does not contain the part is no level."""
    sizes, starts = [100, 140, 200, 260, 500], [0, 0, 0, 50, 0]
    found = made(sizes, [50, 1, 10, 40, 3], starts=starts)
    assert ladder(found, AREA) == ([0, 2, 4], 0)
    assert ladder(made(sizes, [50, 12, 2, 1, 3], starts=starts), AREA) == ([0, 1, 4], 0)
    inner = made([100, 140, 200, 260, 500], [3, 2, 10, 40, 200], starts=[50, 0, 0, 400, 0])
    assert ladder(inner, AREA) == ([0, 2, 4], 2)


@pytest.fixture(scope="module")
def pair():
    """Return the trees of a ball and of a loose ball so small that no region of its size would be a candidate."""
    large, small = trimesh.creation.icosphere(4), trimesh.creation.icosphere(2, 0.02)
    both = trimesh.util.concatenate([large, small.apply_translation((1.1, 0, 0))])
    parts = Parts(dfd.Mesh(both.vertices, both.faces), lambda some: np.ones((len(some), 4), np.float32))
    return parts, len(large.vertices)


def test_things_are_candidates_of_any_size_up_to_nearly_the_whole_shape(pair):
    parts, count = pair
    patches = parts._patches
    small = patches.things[0] == patches.things[0][patches.of_vertex[count]]
    assert patches.area @ small < SMALLEST
    found = candidates(parts._trees, int(patches.of_vertex[count]))
    np.testing.assert_array_equal(found.regions[found.own], [small])
    np.testing.assert_array_equal(found.nodes[found.own], np.flatnonzero((parts._trees.inside == small).all(axis=1)))
    found = candidates(parts._trees, int(patches.of_vertex[0]))
    assert not found.own.any()
    assert (found.regions @ patches.area).max() <= LARGEST


def test_without_a_candidate_the_part_is_the_whole_shape(pair, monkeypatch):
    monkeypatch.setattr(choose, "SMALLEST", 2.0)
    found = candidates(pair[0]._trees, 0)
    assert found.regions.tolist() == [[True] * found.regions.shape[1]]
    assert (found.own.tolist(), found.votes.tolist(), found.clear) == ([False], [1], False)
    assert ladder(found, pair[0]._patches.area) == ([0], 0)
