"""Test weights for usual skinning: they sum to 1, and give the vertices of `dfd.pose`."""

import numpy as np
import pytest
import torch
from posing.made_motion import scene

import dfd


def test_usual_skinning_gives_the_vertices_of_pose():
    vertices, weights, transforms = scene(200, 4, dtype=np.float64)
    skin = dfd.skinning(weights)
    assert skin.shape == (200, 5)
    assert skin.dtype == np.float32
    np.testing.assert_allclose(skin.sum(axis=1), 1, atol=1e-6)
    joints = np.concatenate([transforms, np.eye(3, 4)[None]])
    homogeneous = np.concatenate([vertices, np.ones((200, 1))], axis=1)
    usual = np.einsum("vh,hij,vj->vi", skin, joints, homogeneous)
    np.testing.assert_allclose(usual, dfd.pose(vertices, weights, transforms, overlap="normalize"), atol=1e-5)
    assert np.abs(usual - dfd.pose(vertices, weights / 9, transforms)).max() > 0.1


def test_a_tensor_gives_a_tensor_with_gradients():
    weights = torch.tensor([[0.25, 0.25], [1.5, 0.5]], dtype=torch.float64, requires_grad=True)
    skin = dfd.skinning(weights)
    np.testing.assert_allclose(skin.detach().numpy(), dfd.skinning(weights.detach().numpy()), atol=1e-7)
    assert torch.autograd.gradcheck(dfd.skinning, weights)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ([[0.5, -0.1]], "must be at least 0, got -0.1"),
        ([0.5], r"must have shape \(V, H\), got \(1,\)"),
        ([[np.nan]], "must be finite"),
    ],
)
def test_refusals(weights, message):
    for given in (weights, torch.tensor(weights)):
        with pytest.raises(ValueError, match="^skinning: `weights` " + message):
            dfd.skinning(given)
