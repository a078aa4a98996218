"""Test the cues of a surface for its up direction."""

import numpy as np
import pytest
from made_table import table

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
    assert upright["middle"] > 0.85  # most of the surface is at the top
    assert upright["middle"] + upside_down["middle"] == pytest.approx(1)
    assert upright["mirrors upright"] < 0.02 < upright["mirrors flat"]


def test_a_shape_rests_where_its_middle_is_above_an_edge():
    """An upright triangle rests stably on each of its three sides, and a strongly oblique triangle on two."""
    frame = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    for tip, ways in (((0.5, 0.8, 0), 3), ((3.0, 0.5, 0), 2)):
        mesh = dfd.Mesh([[0, 0, 0], [1, 0, 0], tip], [[0, 1, 2]])
        ups = StabilityCues(mesh.vertices, mesh.faces).stable_ups(frame)
        heights = [mesh.vertices @ up for up in ups]
        lowest = [np.sort(height - height.min())[1] for height in heights]
        assert sum(second < 1e-9 for second in lowest) == ways
        assert np.allclose(ups[:, 2], 0)
