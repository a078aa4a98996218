"""What follows a handle once counterparts have their share."""

from __future__ import annotations

import numpy as np
from made_field import field_of

import dfd


def test_only_leaves_the_other_legs_alone() -> None:
    sample = dfd.samples.chair(4000)
    mesh = sample.mesh
    session = dfd.Deformer(mesh, field_of(mesh), features=np.eye(16, dtype=np.float32)[sample.labels])
    legs = [sample.vertices_of("leg", leg) for leg in range(4)]
    foot = int(legs[0][mesh.vertices[legs[0], 1].argmin()])
    handle = session.add(foot)
    np.testing.assert_array_equal(session.following, session.weights)
    session.change(handle, counterparts="only")
    assert session.following[foot, 0] == 1
    for leg in legs[1:]:
        feet = leg[mesh.vertices[leg, 1].argmin()]
        assert session.weights[feet, 0] == 1
        assert session.following[feet, 0] == 0
