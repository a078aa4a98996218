"""Test that the sets of a place are nested: on made regions, and on shapes."""

from itertools import pairwise

import numpy as np
import pytest
from prepared import sample_parts
from test_alike import Row, run

from dfd.segmentation.levels import Ladder

FOLLOW = ("all", "mirror", "none")


class Rungs(Row):
    """Regions of a row that follow only the regions for which they are given."""

    def __init__(self, followers):
        self.of = {run(*region).tobytes(): Row(likely) for region, likely in followers.items()}
        super().__init__([])

    def followers(self, region, *args, **kwargs):
        found = self.of.get(region.tobytes())
        return found.followers(region, *args, **kwargs) if found else []

    def grown(self, component, like, taken):
        return self.of[like.tobytes()].grown(component, like, taken) if like.tobytes() in self.of else component


def ends(components):
    return [(int(each.argmax()), int(each.argmax() + each.sum())) for each in components]


RUNGS = [run(2, 6), run(0, 10), run(0, 20)]


def test_a_larger_level_keeps_the_components_of_the_smaller_one():
    alike = Rungs({(0, 10): [((30, 40), 0.9), ((60, 70), 0.9)], (0, 20): [((28, 48), 0.9), ((80, 99), 0.9)]})
    assert ends(Ladder(alike, RUNGS, 1).components(0, "all")) == [(0, 10), (30, 40), (60, 70)]
    assert ends(Ladder(alike, RUNGS, 1).components(1, "all")) == [(0, 20), (28, 48), (80, 99), (60, 70)]
    assert ends(Ladder(alike, RUNGS, 1).components(1, "none")) == [(0, 20)]


def test_a_component_that_no_region_contains_grows_or_joins_the_region_that_cuts_it():
    grows = Rungs({(0, 10): [((30, 40), 0.9)], (0, 20): [((35, 55), 0.99), ((28, 48), 0.9)]})
    assert ends(Ladder(grows, RUNGS, 1).components(1, "all")) == [(0, 20), (28, 48)], "no region cuts a component"
    cut = Rungs({(0, 10): [((15, 25), 0.9)]})
    assert ends(Ladder(cut, RUNGS, 1).components(1, "all")) == [(0, 25)]


def test_a_smaller_level_has_only_regions_inside_the_components_of_the_larger_one():
    inside = {(0, 10): [((30, 40), 0.9)], (2, 6): [((32, 36), 0.9), ((7, 10), 0.9), ((38, 42), 0.9), ((50, 54), 0.9)]}
    assert ends(Ladder(Rungs(inside), RUNGS, 1).components(-1, "all")) == [(2, 6), (32, 36), (7, 10)]
    across = {(0, 10): [((30, 40), 0.9), ((40, 50), 0.9)], (2, 6): [((38, 42), 0.9)]}
    assert ends(Ladder(Rungs(across), RUNGS, 1).components(-1, "all")) == [(2, 6)], "a region lies in one component"


@pytest.mark.parametrize("name", ["quadruped", "robot"])
@pytest.mark.parametrize("follow", FOLLOW)
def test_the_part_of_a_level_contains_the_parts_of_all_lower_levels(name, follow):
    sample, parts = sample_parts(name)
    for vertex in np.linspace(0, len(sample.mesh.vertices) - 1, 6).astype(int).tolist():
        lowest, highest = parts.levels(vertex)
        masks = [parts.part(vertex, level, follow=follow).mask for level in range(lowest, highest + 1)]
        for smaller, larger in pairwise(masks):
            assert not (smaller & ~larger).any(), vertex


def test_what_is_left_out_may_be_alike_but_does_not_belong_to_the_part():
    sample, parts = sample_parts("quadruped")
    found = 0
    for vertex in np.linspace(0, len(sample.mesh.vertices) - 1, 20).astype(int).tolist():
        left = parts.left_out(vertex)
        found += len(left)
        assert not parts.part(vertex).mask[left].any()
        assert parts.left_out(vertex, 99) == parts.left_out(vertex, parts.levels(vertex)[1])
    assert found > 0
