"""Test what the first pages promise about the samples: one hoof, foot or horn stands for all of its kind."""

import pytest
from prepared import sample_parts


@pytest.mark.parametrize(
    ("name", "part", "components"),
    [
        ("quadruped", "hoof", 4),
        ("quadruped", "horn", 2),
        ("quadruped", "ear", 2),
        ("chair", "leg", 4),
        ("robot", "foot", 2),
    ],
)
def test_all_of_a_kind_follow_one(name, part, components):
    sample, parts = sample_parts(name)
    vertices = sample.vertices_of(part, 0)
    lowest, highest = sample.mesh.vertices[vertices, 1].argmin(), sample.mesh.vertices[vertices, 1].argmax()
    tip = lowest if part in ("hoof", "leg", "foot") else highest
    assert parts.part(int(vertices[tip])).components == components
