"""Test the gradients of a linear blend, and the errors for options without gradients."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from posing.made_motion import scene

import dfd

PLANE = dfd.SymmetryPlane((0.6, 0.0, 0.8), 0.25, band=0.7)
DEFAULT = np.eye(3, 4) + 0.1 * np.arange(12).reshape(3, 4)


def tensors(dtype=np.float64):
    vertices, weights, transforms = scene(12, 3, dtype=dtype)
    return [torch.from_numpy(array).requires_grad_() for array in (vertices, weights, transforms)]


@pytest.mark.parametrize("overlap", ["add", "paper", "normalize"])
@pytest.mark.parametrize("symmetry", [None, PLANE, dfd.SymmetryPlane(PLANE.normal, PLANE.offset)])
@pytest.mark.parametrize("default", [None, DEFAULT])
def test_gradients_are_those_of_finite_differences(overlap, symmetry, default):
    vertices, weights, transforms = tensors()
    options = {"overlap": overlap, "symmetry": symmetry, "default": default, "handles": [0, 1, 2]}
    direction = torch.from_numpy(np.random.default_rng(5).standard_normal((12, 3)))
    posed = dfd.pose(vertices, weights, transforms, **options)
    np.testing.assert_array_equal(
        posed.detach().numpy(),
        dfd.pose(vertices.detach().numpy(), weights.detach().numpy(), transforms.detach().numpy(), **options),
    )
    (posed * direction).sum().backward()

    def height(*arrays):
        return float((dfd.pose(*arrays, **options) * direction.numpy()).sum())

    arrays = [tensor.detach().numpy() for tensor in (vertices, weights, transforms)]
    random = np.random.default_rng(7)
    for k, tensor in enumerate((vertices, weights, transforms)):
        assert tensor.grad.dtype == tensor.dtype
        assert tensor.grad.shape == tensor.shape
        step = (1e-3 if k == 1 else 1e-6) * random.standard_normal(tensor.shape)
        if k == 1:  # a larger step for float32: the blend is linear in weights, except at sum 1
            keep = np.abs(arrays[1].sum(axis=1) - 1) > 0.01
            step *= keep[:, None]
        ahead, behind = (
            [array + sign * step.astype(array.dtype) if j == k else array for j, array in enumerate(arrays)]
            for sign in (1, -1)
        )
        wanted = (height(*ahead) - height(*behind)) / 2
        taken = (ahead[k].astype(np.float64) - behind[k]) / 2
        assert float((tensor.grad.numpy() * taken).sum()) == pytest.approx(wanted, rel=2e-3, abs=1e-8)


def test_without_recording_tensors_are_taken_as_they_are():
    vertices, weights, transforms = tensors()
    with torch.no_grad():
        posed = dfd.pose(vertices, weights, transforms, blend="dual_quaternion")
    assert not posed.requires_grad


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"blend": "dual_quaternion"}, r'only blend="linear" without overlap="interpolate" has gradients'),
        ({"overlap": "interpolate"}, r'only blend="linear" without overlap="interpolate" has gradients'),
        ({"default": torch.eye(4, requires_grad=True)}, r"`default` has no gradient"),
        ({"normals": np.ones((12, 3))}, r"`normals` must not be given with tensors that require gradients"),
        ({"out": torch.empty(12, 3, dtype=torch.float64)}, r"`out` must not be given with tensors that require"),
        ({"weights": torch.ones(12, 3, dtype=torch.float16, requires_grad=True)}, r"`weights` must be float32 or"),
        ({"transforms": np.zeros((5, 4, 2))}, r"`transforms` must have shape"),
    ],
)
def test_refusals(arguments, message):
    vertices, weights, transforms = tensors()
    with pytest.raises(ValueError, match="^pose: " + message):
        dfd.pose(**{"vertices": vertices, "weights": weights, "transforms": transforms, **arguments})


def test_a_drag_refuses():
    vertices, weights, transforms = tensors()
    with pytest.raises(ValueError, match=r"^Drag: a drag has no gradients: detach"):
        dfd.Drag(vertices, weights, transforms, [0])
    drag = dfd.Drag(vertices.detach(), weights.detach(), transforms.detach(), [0])
    with pytest.raises(ValueError, match=r"^Drag.pose: a drag has no gradients: detach"):
        drag.pose(transforms[:1])


def test_arrays_that_cannot_be_written_to_stand_beside_tensors():
    vertices, weights, transforms = tensors()
    fixed = vertices.detach().numpy()
    fixed.flags.writeable = False
    posed = dfd.pose(fixed, weights, transforms.detach().numpy())
    posed.sum().backward()
    assert weights.grad is not None
    assert not np.shares_memory(posed.detach().numpy(), fixed)
