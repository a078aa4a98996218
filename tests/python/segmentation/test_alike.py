"""Test which regions look like a part, on a row of patches with made features and measures."""

from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
import trimesh

import dfd
from dfd.segmentation import alike as module
from dfd.segmentation.alike import SIMILAR, _measures, alike
from dfd.segmentation.parts import Parts

COUNT = 100  # number of patches, all of one area; patches with neighboring numbers touch


class Row:
    """Trees of regions of a row of patches. The strength of every boundary is `strength`."""

    def __init__(self, regions, *, strength=1.0, orbit=None, values=None):
        self.inside = np.zeros((len(regions), COUNT), bool)
        for row, runs in zip(self.inside, regions, strict=True):
            for start, end in runs:
                row[start:end] = True
        area = np.full(COUNT, 1 / COUNT)
        self.values = np.zeros((COUNT, 2)) if values is None else values
        self.patches = SimpleNamespace(area=area, orbit=np.arange(COUNT) if orbit is None else orbit)
        self.areas = self.inside @ area
        self.means = np.array([self.mean(row) for row in self.inside])
        self.boundary = lambda region: strength

    def labels(self, inside):
        return np.cumsum(np.append(0, inside[1:] != inside[:-1]))

    def components(self, inside):
        label = self.labels(inside)
        return [label == number for number in np.unique(label[inside])]

    def mean(self, region):
        return self.values[region].mean(axis=0)

    def around(self, region):
        wide = region | np.append(region[1:], False) | np.append(False, region[:-1])
        return wide & ~region

    def contrast(self, region):
        return float(np.linalg.norm(self.mean(region) - self.mean(self.around(region))))


def run(start, end):
    region = np.zeros(COUNT, bool)
    region[start:end] = True
    return region


def found(trees, region, node=0):
    """Return the first patch of each component, by measures that are the logarithm of the size alone."""
    with mock.patch.object(module, "_measures", lambda _, each: np.log(np.array([each.sum(), 1.0]))):
        return [int(each.argmax()) for each in alike(trees, node, region)]


def test_measures_are_the_logarithms_of_area_border_and_extents():
    made = trimesh.creation.icosphere(4).apply_scale((3, 2, 1))
    parts = Parts(dfd.Mesh(made.vertices, made.faces), lambda some: np.ones((len(some), 4), np.float32))
    trees, patches = parts._trees, parts._patches
    region = patches.center[:, 0] > 0.2
    area, points = patches.area[region], patches.center[region]
    extents = np.sqrt(np.linalg.eigvalsh(np.cov(points.T, aweights=area, ddof=0)))
    at_border = np.not_equal(*region[patches.borders.pairs.T])
    length = patches.borders.length[at_border]
    clear = 0.1 + np.average(trees.strength[at_border], weights=length)
    wanted = [area.sum(), length.sum(), clear, *(extents + patches.spacing)]
    np.testing.assert_allclose(np.exp(_measures(trees, region)), wanted, rtol=1e-5)
    whole = np.ones(len(region), bool)
    assert np.exp(_measures(trees, whole))[1:3] == pytest.approx((1e-9, 1.1))


@pytest.mark.parametrize(("mirrored", "follows"), [(9, True), (11, True), (7, False)])
def test_mirror_images_of_the_larger_half_of_a_component_are_alike(mirrored, follows):
    """The other component of the node is twice as long, so only its mirror images make it alike."""
    orbit = np.arange(COUNT)
    orbit[50 : 50 + mirrored] = 3
    trees = Row([[(0, 8), (50, 66)]], strength=0.0, orbit=orbit)
    assert found(trees, run(0, 8)) == ([0, 50] if follows else [0])


@pytest.mark.parametrize(("size", "follows"), [(10, True), (15, True), (19, True), (6, True), (21, False), (4, False)])
def test_components_of_one_region_are_alike_if_their_measures_are(size, follows):
    trees = Row([[(0, 10), (50, 50 + size)]], strength=0.0)
    assert found(trees, run(0, 10)) == ([0, 50] if follows else [0])
    assert SIMILAR == 2


def test_regions_elsewhere_are_alike_the_most_similar_first():
    """The features of the regions from 50 on differ from those of the part by so many units."""
    values = np.zeros((COUNT, 2))
    values[10:12, 1] = 0.2  # around the part, so that the contrast is 0.2
    runs = [(30, 40), (50, 60), (70, 84), (88, 94)]
    for (start, end), apart in zip(runs, (0.9, 0.2, 0.0, 0.99), strict=True):
        values[start:end, 0] = apart * 1.5 * 0.2
    values += (7, -5)
    trees = Row([[(0, 10)], *([each] for each in runs)], values=values)
    assert found(trees, run(0, 10)) == [0, 50, 70, 30]
    values[50:60, 0] = 7 + 1.01 * 1.5 * 0.2
    assert found(Row([[(0, 10)], *([each] for each in runs)], values=values), run(0, 10)) == [0, 70, 30]
    # A part without a clear boundary has no such counterparts.
    assert found(Row([[(0, 10)], *([each] for each in runs)], values=values, strength=0.09), run(0, 10)) == [0]


@pytest.mark.parametrize(("apart", "follows"), [(1.38, True), (1.45, False)])
def test_features_that_differ_as_those_of_random_points_are_never_alike(apart, follows):
    values = np.zeros((COUNT, 2))
    values[10, 1], values[50:60, 0] = 9.0, apart
    assert found(Row([[(0, 10)], [(50, 60)]], values=values), run(0, 10)) == ([0, 50] if follows else [0])


def test_regions_that_touch_the_part_or_are_half_as_large_are_not_alike():
    values = np.zeros((COUNT, 2))
    values[10, 1] = 1.0
    for runs, follows in (([(10, 20)], []), ([(11, 21)], [11]), ([(5, 12)], []), ([(60, 66)], [60]), ([(60, 64)], [])):
        assert found(Row([[(0, 10)], runs], values=values), run(0, 10)) == [0, *follows]
    # A node that is large enough in total has two components. The larger one is alike.
    assert found(Row([[(0, 10)], [(40, 43), (60, 69)]], values=values), run(0, 10)) == [0, 60]


def test_no_two_components_overlap_and_there_are_at_most_64():
    values = np.zeros((COUNT, 2))
    values[10, 1], values[62:72, 0] = 1.0, 0.1
    assert found(Row([[(0, 10)], [(60, 70)], [(62, 72)], [(75, 85)]], values=values), run(0, 10)) == [0, 75, 60]
    with mock.patch.object(module, "MOST", 2):
        assert found(Row([[(0, 10)], [(60, 70)], [(75, 85)]], values=values), run(0, 10)) == [0, 75]
    with mock.patch.object(module, "MOST", 3):
        assert len(found(Row([[(0, 10)], [(60, 70)], [(75, 85)]], values=values), run(0, 10))) == 3


def test_counterparts_of_a_closed_part_are_closed():
    """The part is a run at the end of the row with all beyond it; its counterpart ends the row on the other side."""
    trees = Row([[(5, 15), (85, 95)]], strength=0.0)
    region = run(0, 15)
    with mock.patch.object(module, "_measures", lambda _, each: np.log(np.array([each.sum(), 1.0]))):
        both = alike(trees, 0, region)
    np.testing.assert_array_equal(both, [region, run(85, 100)])
    alone = run(5, 15)
    with mock.patch.object(module, "_measures", lambda _, each: np.log(np.array([each.sum(), 1.0]))):
        np.testing.assert_array_equal(alike(trees, 0, alone), [alone, run(85, 95)])
