"""What a surface tells of how it would stand."""

from __future__ import annotations

import numpy as np
import pytest
from made_table import table
from scipy.spatial.transform import Rotation

import dfd
from dfd.upright.candidates import axis_frames
from dfd.upright.stability import EVIDENCE, StabilityCues


def test_evidence_of_a_table():
    mesh = table()
    standing = StabilityCues(mesh.vertices, mesh.faces)
    upright, upside_down = (
        dict(zip(EVIDENCE, standing.evidence(frame), strict=True)) for frame in axis_frames(np.eye(3))[2:4]
    )
    assert upright["stable"] == upside_down["stable"] == 1
    assert upright["base"] == pytest.approx(1.9 * 0.9 / (2 * 1), rel=1e-6)
    assert upside_down["base"] == pytest.approx(1, rel=1e-6)
    assert upright["near the base"] < upside_down["near the base"]
    assert upright["middle"] > 0.85  # most of its surface is its top
    assert upright["middle"] + upside_down["middle"] == pytest.approx(1)
    assert upright["mirrors upright"] < 0.02 < upright["mirrors flat"]


def test_a_table_on_two_of_its_legs_would_fall():
    mesh = table()
    angle = np.radians(20)
    frame = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    assert StabilityCues(mesh.vertices, mesh.faces).evidence(frame)[EVIDENCE.index("stable")] == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_tilted_shape_gets_axes_of_its_own(seed):
    mesh = table()
    assert np.array_equal(StabilityCues(mesh.vertices, mesh.faces).frame(), np.eye(3))
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    frame = StabilityCues(mesh.vertices @ rotation.T, mesh.faces).frame()
    assert np.linalg.det(frame) == pytest.approx(1)
    assert np.abs(frame @ rotation[:, 1]).max() > np.cos(np.radians(3))


def test_a_shape_rests_where_its_middle_is_above_an_edge():
    """A triangle seen from the side rests on each of its sides; one that leans far only on two."""
    frame = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    for tip, ways in (((0.5, 0.8, 0), 3), ((3.0, 0.5, 0), 2)):
        mesh = dfd.Mesh([[0, 0, 0], [1, 0, 0], tip], [[0, 1, 2]])
        ups = StabilityCues(mesh.vertices, mesh.faces).stable_ups(frame)
        heights = [mesh.vertices @ up for up in ups]
        lowest = [np.sort(height - height.min())[1] for height in heights]
        assert sum(second < 1e-9 for second in lowest) == ways
        assert np.allclose(ups[:, 2], 0)
