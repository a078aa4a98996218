"""Test how a cut gives patches to parts, on a row of patches."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import diags_array

from dfd.segmentation.cut import LEAST_AREA, _nearest, _overlap, _without_fragments


def row(count, **more):
    """Return trees of a row of patches of one area. Neighbors have a distance of 1."""
    pairs = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    borders = SimpleNamespace(pairs=pairs, length=np.ones(count - 1))
    area = np.full(count, 1 / count)
    patches = SimpleNamespace(**{"area": area, "orbit": np.arange(count), "borders": borders} | more)
    links = diags_array([np.ones(count - 1)] * 2, offsets=[-1, 1], shape=(count, count)).tocsr()
    return SimpleNamespace(patches=patches, links=links)


def run(count, start, end):
    return (np.arange(count) >= start) & (np.arange(count) < end)


def test_a_patch_belongs_to_the_nearest_handle_whose_part_contains_it():
    handles, of_handle = np.array([2, 9]), np.array([0, 1])
    groups = [[run(12, 0, 4)], [run(12, 2, 12)]]
    assert _nearest(row(12), handles, of_handle, groups).tolist() == [0] * 4 + [1] * 8
    groups[0] = [run(12, 0, 12)]
    assert _nearest(row(12), handles, of_handle, groups).tolist() == [0] * 6 + [1] * 6


def test_a_handle_stands_for_its_mirror_images_and_for_counterparts_without_another_handle():
    count, handles, of_handle = 20, np.array([2, 12]), np.array([0, 1])
    own, far, other = run(count, 0, 5), run(count, 15, 20), run(count, 8, 20)
    label = _nearest(row(count), handles, of_handle, [[own, far], [other]])
    assert label[15:].tolist() == [0] * 5
    # The handle of the other part lies on the counterpart.
    label = _nearest(row(count), np.array([2, 16]), of_handle, [[own, far], [other]])
    assert label[15:].tolist() == [1] * 5
    # So does an image of the first handle, which stands for all of the counterpart that is not taken.
    orbit = np.arange(count)
    orbit[18] = 2
    label = _nearest(row(count, orbit=orbit), np.array([2, 16]), of_handle, [[own, far], [other]])
    assert label[15:].tolist() == [0, 1, 0, 0, 0]


@pytest.mark.parametrize(("common", "same"), [(4, True), (3, False)])
def test_regions_are_one_part_if_half_of_their_union_is_common(common, same):
    assert _overlap(row(20), run(20, 0, 6), run(20, 6 - common, 12 - common)) == same


def test_small_parts_join_the_part_that_they_touch_most():
    trees = row(5)
    trees.patches.area = np.array([0.5, 0.2, 0.299, 0.6 * LEAST_AREA, 0.4 * LEAST_AREA])
    trees.patches.borders.pairs = np.array([(0, 3), (1, 3), (2, 3), (0, 1), (2, 4)])
    trees.patches.borders.length = np.array([1.0, 1.5, 1.0, 2.0, 0.0])
    assert _without_fragments(trees, np.array([0, 1, 2, 3, 4])).tolist() == [0, 1, 2, 1, 2]
    trees.patches.area[3] = 1.01 * LEAST_AREA
    assert _without_fragments(trees, np.array([0, 1, 2, 3, 4])).tolist() == [0, 1, 2, 3, 2]
    # Two borders with the same part count together.
    assert _without_fragments(trees, np.array([0, 1, 0, 4, 4])).tolist() == [0, 1, 0, 4, 4]
    trees.patches.area[3] = 0.5 * LEAST_AREA
    assert _without_fragments(trees, np.array([0, 1, 0, 4, 4])).tolist() == [0, 1, 0, 0, 0]
