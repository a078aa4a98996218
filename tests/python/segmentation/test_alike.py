"""Test which regions look like a part, on a row of patches with made probabilities and on shapes."""

from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
import trimesh

import dfd
from dfd.samples.implicit import Primitive, Shape, capsule, rounded_box
from dfd.samples.polygonize import polygonize
from dfd.segmentation import alike as module
from dfd.segmentation.alike import CUES, LIKELY, POSSIBLE, Alike, compared, pair_cues
from dfd.segmentation.parts import Parts
from dfd.segmentation.regions import all_regions, measured

COUNT = 100  # number of patches, all of one area; patches with neighboring numbers touch


def run(start, end):
    region = np.zeros(COUNT, bool)
    region[start:end] = True
    return region


class Row(Alike):
    """The regions of a row of patches, with made probabilities."""

    def __init__(self, likely, orbit=None):
        area = np.full(COUNT, 1 / COUNT)
        patches = SimpleNamespace(area=area, orbit=np.arange(COUNT) if orbit is None else orbit)
        super().__init__(SimpleNamespace(patches=patches, components=self._components, around=self._around))
        self.likely = [(run(*ends), probability) for ends, probability in likely]
        self.regions = np.array([region for region, _ in self.likely]).reshape(-1, COUNT)

    def _components(self, inside):
        label = np.cumsum(np.append(0, inside[1:] != inside[:-1]))
        return [label == number for number in np.unique(label[inside])]

    def _around(self, region):
        return (np.append(region[1:], False) | np.append(False, region[:-1])) & ~region

    def _likely(self, region):
        found = [(-p, i) for i, (each, p) in enumerate(self.likely) if not (each & region).any()]
        return np.array([i for _, i in sorted(found)], int), np.array([-p for p, _ in sorted(found)])


def starts(followers):
    return [int(each.region.argmax()) for each in followers]


def test_likely_regions_follow_the_most_likely_first():
    row = Row([((20, 30), 0.9), ((40, 50), LIKELY), ((60, 70), LIKELY - 0.01), ((80, 90), 0.99)])
    found = row.followers(run(0, 10))
    assert starts(found) == [80, 20, 40]
    assert [each.probability for each in found] == [0.99, 0.9, LIKELY]
    assert starts(row.followers(run(0, 10), least=POSSIBLE)) == [80, 20, 40, 60]
    assert row.followers(run(0, 10), "none") == []


def test_no_two_followers_overlap_and_a_part_has_at_most_64_components():
    row = Row([((20, 30), 0.9), ((25, 35), 0.99), ((34, 40), 0.95), ((40, 50), 0.9)])
    assert starts(row.followers(run(0, 10))) == [25, 40]
    assert starts(row.followers(run(0, 26))) == [34, 40]
    with mock.patch.object(module, "MOST", 2):
        assert starts(row.followers(run(0, 10))) == [25]


def test_followers_lie_inside_the_given_patches():
    row = Row([((20, 30), 0.9), ((40, 50), 0.9)])
    assert starts(row.followers(run(0, 10), within=run(0, 45))) == [20]


@pytest.mark.parametrize(("size", "follows"), [(10, True), (11, True), (12, False), (9, False)])
def test_mirror_images_follow_if_they_have_nearly_the_area_of_the_part(size, follows):
    orbit = np.arange(COUNT)
    orbit[60 : 60 + size] = 3
    row = Row([((20, 30), 0.99)], orbit)
    assert starts(row.followers(run(0, 10), "mirror")) == ([60] if follows else [])
    assert starts(row.followers(run(0, 10))) == ([60, 20] if follows else [20])


def test_a_mirror_image_that_touches_the_part_does_not_follow():
    orbit = np.arange(COUNT)
    orbit[10:20] = 3
    assert Row([], orbit).followers(run(0, 10), "mirror") == []


def test_the_mirror_images_of_what_follows_follow_too():
    orbit = np.arange(COUNT)
    orbit[60:70] = np.arange(20, 30)
    row = Row([((20, 30), 0.9), ((61, 71), 0.88)], orbit)
    assert starts(row.followers(run(0, 10))) == [20, 60]


def test_a_component_grows_to_the_region_around_it_that_looks_most_like_the_part():
    row = Row([((18, 40), 0.9), ((19, 41), 0.95), ((15, 60), 0.99), ((22, 50), 1.0)])
    component, part = run(20, 30), run(0, 10)
    np.testing.assert_array_equal(row.grown(component, part, part | run(55, 60)), run(19, 41))
    np.testing.assert_array_equal(row.grown(component, part, part), run(15, 60))
    unlikely = Row([((18, 40), LIKELY - 0.01)])
    np.testing.assert_array_equal(unlikely.grown(component, part, part), component)


def comb(short):
    """Return a bar with four equal teeth and a last one of the length `short`, and its parts."""
    rods = [
        Primitive("tooth", capsule((0, 0.7, z), (0, 0.7 + (0.5 if z < 0.7 else short), z), 0.06), blend=0.01)
        for z in np.linspace(-0.8, 0.8, 5).tolist()
    ]
    bar = Primitive("bar", rounded_box((0, 0.6, 0), (0.12, 0.12, 1.0), 0.05))
    vertices, faces = polygonize(Shape([bar, *rods]), (-0.4, 0.3, -1.2), (0.4, 1.5, 1.2), 6000)
    rows = np.ones((len(vertices), 2), np.float32)
    rows[:, 0] = np.clip((vertices[:, 1] - 0.7) / 0.05, -1, 1)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return vertices, Parts(dfd.Mesh(vertices, faces), lambda some: rows[some])


@pytest.fixture(scope="module")
def measures():
    made = trimesh.creation.icosphere(4).apply_scale((3, 2, 1))
    parts = Parts(dfd.Mesh(made.vertices, made.faces), lambda some: made.vertices[some].astype(np.float32))
    return parts._trees


def test_measures_of_regions_are_those_of_their_definition(measures):
    trees, patches = measures, measures.patches
    region = patches.center[:, 0] > 0.2
    found = measured(trees, np.array([region, np.ones(len(region), bool)]))
    area, points = patches.area[region], patches.center[region]
    extents = np.sqrt(np.linalg.eigvalsh(np.cov(points.T, aweights=area, ddof=0)))
    at_border = np.not_equal(*region[patches.borders.pairs.T])
    length, ends = patches.borders.length[at_border], patches.borders.pairs[at_border]
    rim = np.average(patches.center[ends].mean(axis=1), axis=0, weights=length)
    around = trees.around(region)
    mean, outer = (np.average(trees.values[each], axis=0, weights=patches.area[each]) for each in (region, around))
    assert found.area[0] == pytest.approx(area.sum())
    assert found.border[0] == pytest.approx(length.sum(), rel=1e-5)
    np.testing.assert_allclose(found.extents[0], extents, rtol=1e-6)
    assert found.reach[0] == pytest.approx(np.linalg.norm(np.average(points, axis=0, weights=area) - rim), rel=1e-5)
    np.testing.assert_allclose(found.mean[0], mean, atol=1e-9)
    assert found.contrast[0] == pytest.approx(np.linalg.norm(mean - outer))
    assert (found.reach[1], found.contrast[1]) == (0, 1), "the whole shape has no surroundings"
    assert np.sqrt(patches.area @ np.square(trees.values).sum(axis=1)) == pytest.approx(1)


def test_cues_of_a_pair_are_those_of_their_definition(measures):
    trees, patches = measures, measures.patches
    one, other = patches.center[:, 0] > 0.3, patches.center[:, 0] < -0.35
    beside = trees.around(one)
    own, others = measured(trees, one[None]), measured(trees, np.array([other, beside]))
    found = dict(zip(CUES, pair_cues(trees, own, others).T, strict=True))
    assert found["area"][0] == pytest.approx(abs(np.log(patches.area @ one / (patches.area @ other))), rel=1e-6)
    apart = np.linalg.norm(own.mean - others.mean, axis=1)
    np.testing.assert_allclose(found["features"], apart / ((own.contrast + others.contrast) / 2 + 0.1))
    assert found["touching"].tolist() == [0, 1]
    assert found["size"] == pytest.approx(np.log(own.area[0] + 0.1))
    assert found["clear"] == pytest.approx(np.log(own.contrast[0] + 0.1))
    for name in ("border", "thickness", "width", "length", "reach", "contrast"):
        assert pair_cues(trees, own, own)[0, CUES.index(name)] == 0


def test_regions_are_compared_if_they_do_not_overlap(measures):
    trees = measures
    regions = all_regions(trees)
    assert len(np.unique(np.packbits(regions, axis=1), axis=0)) == len(regions)
    own = regions[len(regions) // 2]
    rows, cues, near = compared(trees, own, measured(trees, regions))
    np.testing.assert_array_equal(rows, np.flatnonzero(~(regions & own).any(axis=1)))
    one, others = measured(trees, own[None]), measured(trees, regions[rows])
    np.testing.assert_allclose(cues, pair_cues(trees, one, others))
    np.testing.assert_array_equal(near, np.linalg.norm(one.mean - others.mean, axis=1) < 2**0.5)


def test_equal_teeth_of_a_comb_follow_each_other_and_a_short_one_does_not():
    vertices, parts = comb(short=0.15)
    places = np.column_stack([np.zeros(5), [1.2, 1.2, 1.2, 1.2, 0.9], np.linspace(-0.8, 0.8, 5)])
    *tips, short = [int(np.linalg.norm(vertices - place, axis=1).argmin()) for place in places]
    for tip in tips:
        mask = parts.part(tip).mask
        assert mask[tips].all(), tip
        assert not mask[short], tip
        assert parts.part(tip, follow="none").mask[tips].sum() == 1
