"""Test how well parts agree with the known parts of generated shapes, with features that know nothing about parts."""

import numpy as np
import pytest

import dfd
from bench.training.made_shapes import made_shape
from dfd.geometry.topology import face_areas
from dfd.segmentation.parts import Parts

PLACES = 10
# Shapes, and the least mean IoU of the part at a place with the known part. The shapes were not chosen by the results.
FLOORS = {199: 0.55, 200: 0.55}


def waves(vertices):
    """Return features (V, 16): cosines of the positions along random directions."""
    random = np.random.default_rng(0)
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    rows = np.cos(6 * np.pi / size * vertices @ random.normal(size=(3, 16)) + random.uniform(0, 2 * np.pi, 16))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize(("number", "floor"), FLOORS.items())
def test_parts_of_generated_shapes_are_the_known_ones(number, floor):
    shape = made_shape(number)
    mesh, random = shape.mesh, np.random.default_rng(number)
    rows, areas = waves(mesh.vertices), face_areas(mesh.vertices, mesh.faces)
    order = random.permutation(len(mesh.vertices))
    renumbered = Parts(dfd.Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces]), lambda some: rows[order][some])
    parts, found = Parts(mesh, lambda some: rows[some]), []
    for _ in range(PLACES):
        known = shape.parts[random.integers(len(shape.parts))]
        vertex = int(random.choice(np.flatnonzero(known[0])))
        mask = parts.part(vertex, follow="none").mask
        assert np.array_equal(renumbered.part(int(np.flatnonzero(order == vertex)[0]), follow="none").mask, mask[order])
        inside = mask[mesh.faces].sum(axis=1) >= 2
        wanted = [each[mesh.faces].sum(axis=1) >= 2 for each in known]
        found.append(max(areas[inside & each].sum() / areas[inside | each].sum() for each in wanted))
    assert np.mean(found) > floor, np.mean(found)
