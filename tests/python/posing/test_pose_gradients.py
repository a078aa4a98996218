"""Test the gradients of a linear blend, and the errors for options without gradients."""

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
        ({"normals": torch.ones(12, 3, requires_grad=True)}, r"`normals` has no gradient"),
        ({"normals": np.ones((12, 3))}, r"`normals` must not be given with tensors that require gradients"),
        ({"out": torch.empty(12, 3, dtype=torch.float64)}, r"`out` must not be given with tensors that require"),
        ({"weights": torch.ones(12, 3, dtype=torch.complex64, requires_grad=True)}, r"`weights` must be a dense array"),
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
    assert not np.shares_memory(posed.detach().numpy(), fixed)


def twin(vertices, weights, transforms, default, **options):
    """Return the posed vertices, computed by torch in float64."""
    from dfd.posing.gradients import _posed

    how = {"symmetry": None, "handles": None, "overlap": "paper"} | options
    return _posed(vertices, weights, transforms, default, **how)


@pytest.mark.parametrize("overlap", ["add", "paper", "normalize"])
@pytest.mark.parametrize("symmetry", [None, PLANE, dfd.SymmetryPlane(PLANE.normal, PLANE.offset)])
@pytest.mark.parametrize("count", [3, 40, 5000])
def test_the_kernel_agrees_with_its_slow_twin(overlap, symmetry, count):
    options = {"overlap": overlap, "symmetry": symmetry, "handles": [0, 1, 2]}
    arrays = [*scene(count, 5, dtype=np.float64), DEFAULT]
    if symmetry is not None:
        options["handles"] = [0, 1, 2, 0, 1]
    else:
        options["handles"] = None
    direction = torch.from_numpy(np.random.default_rng(5).standard_normal((count, 3)))
    found, wanted = ([torch.from_numpy(array).clone().requires_grad_() for array in arrays] for _ in range(2))
    default = found.pop()
    (dfd.pose(*found, default=default, **options) * direction).sum().backward()
    (twin(*wanted, **options) * direction).sum().backward()
    for mine, theirs in zip([*found, default], wanted, strict=True):
        scale = 1 + theirs.grad.abs().max()
        torch.testing.assert_close(mine.grad / scale, theirs.grad / scale, rtol=0, atol=2e-7)


@pytest.mark.parametrize("layout", ["rows", "columns", "float64"])
def test_float32_gradients_are_near_those_of_float64(layout):
    vertices, weights, transforms = scene(9000, 7)
    weights = np.asfortranarray(weights) if layout == "columns" else weights
    weights = weights.astype(np.float64) if layout == "float64" else weights
    inputs = [torch.from_numpy(array).requires_grad_() for array in (vertices, weights, transforms)]
    direction = torch.from_numpy(np.random.default_rng(5).standard_normal((9000, 3)).astype(np.float32))
    (dfd.pose(*inputs) * direction).sum().backward()
    exact = [value.detach().double().requires_grad_() for value in inputs]
    (twin(*exact, None) * direction).sum().backward()
    for value, other in zip(inputs, exact, strict=True):
        assert value.grad.dtype == value.dtype
        torch.testing.assert_close(value.grad.double(), other.grad, rtol=1e-4, atol=2e-4)


@pytest.mark.parametrize(("overlap", "symmetry"), [("add", None), ("paper", PLANE), ("normalize", PLANE)])
def test_gradcheck_and_gradgradcheck(overlap, symmetry):
    vertices, weights, transforms = tensors()
    default = torch.from_numpy(DEFAULT).requires_grad_()

    def call(vertices, transforms, default):
        return dfd.pose(
            vertices,
            weights.detach(),
            transforms,
            default=default,
            overlap=overlap,
            symmetry=symmetry,
            handles=[0, 1, 2],
        )

    assert torch.autograd.gradcheck(call, (vertices, transforms, default))
    assert torch.autograd.gradgradcheck(call, (vertices, transforms, default))


def test_second_derivatives_by_weights():
    vertices, weights, transforms = tensors()

    def penalty(pose):
        posed = pose(vertices, weights, transforms)
        (by_weights,) = torch.autograd.grad(posed.square().sum(), weights, create_graph=True)
        return torch.autograd.grad(by_weights.square().sum(), (vertices, weights, transforms))

    for mine, theirs in zip(penalty(dfd.pose), penalty(lambda *all: twin(*all, None)), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-5, atol=1e-4)


def test_where_weights_sum_to_1_the_gradient_is_that_of_smaller_sums():
    vertices = torch.tensor([[1.0, 2.0, 3.0]], dtype=torch.float64)
    weights = torch.ones(1, 1, dtype=torch.float64, requires_grad=True)
    transform = torch.eye(3, 4, dtype=torch.float64)[None].clone()
    transform[0, 1, 3] = 5.0
    dfd.pose(vertices, weights, transform).sum().backward()
    assert weights.grad.item() == 5.0
    (again,) = torch.autograd.grad(twin(vertices, weights, transform, None).sum(), weights)
    assert again.item() == 5.0


@pytest.mark.parametrize("size", [3, 4])
def test_a_batch_of_transforms_gives_a_batch_of_poses(size):
    vertices, weights, _ = scene(50, 3)
    batch = np.zeros((4, 3, size, 4))
    batch[:, :, :3] = np.stack([scene(50, 3, seed=seed)[2] for seed in range(4)])
    batch[:, :, 3:] = [0, 0, 0, 1]
    normals = np.tile(np.float32([0, 0, 1]), (50, 1))
    posed, turned = dfd.pose(vertices, weights, batch, normals=normals, blend="dual_quaternion")
    assert posed.shape == turned.shape == (4, 50, 3)
    for k, transforms in enumerate(batch):
        alone, alone_turned = dfd.pose(vertices, weights, transforms, normals=normals, blend="dual_quaternion")
        np.testing.assert_array_equal(posed[k], alone)
        np.testing.assert_array_equal(turned[k], alone_turned)
    out = np.empty((4, 50, 3), np.float32)
    assert dfd.pose(vertices, weights, batch, out=out) is out
    assert dfd.pose(vertices, weights, batch[:0]).shape == (0, 50, 3)


def test_a_batch_has_the_gradients_of_its_poses():
    vertices, weights, _ = scene(50, 3)
    inputs = [torch.from_numpy(vertices).requires_grad_(), torch.from_numpy(weights).requires_grad_()]
    batch = torch.from_numpy(np.stack([scene(50, 3, seed=seed)[2] for seed in range(4)])).requires_grad_()
    default = torch.from_numpy(DEFAULT).requires_grad_()
    leaves = (*inputs, batch, default)
    steps = torch.from_numpy(np.random.default_rng(0).standard_normal((4, 50, 3)).astype(np.float32))
    together = torch.autograd.grad((dfd.pose(*inputs, batch, default=default) * steps).sum(), leaves)
    height = sum((dfd.pose(*inputs, batch[k], default=default) * steps[k]).sum() for k in range(4))
    for mine, theirs in zip(together, torch.autograd.grad(height, leaves), strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-5, atol=1e-5)


def test_a_batch_with_another_number_of_handles_is_refused():
    vertices, weights, _ = scene(5, 3)
    with pytest.raises(ValueError, match=r"^pose: `transforms` must have shape \(B, 3, 3, 4\) or \(B, 3, 4, 4\), got"):
        dfd.pose(vertices, weights, np.zeros((2, 4, 3, 4)))


def test_vmap_jacrev_and_hessian():
    vertices, weights, transforms = (value.detach() for value in tensors())
    batch = torch.stack([transforms, 2 * transforms])
    posed = torch.func.vmap(lambda some: dfd.pose(vertices, weights, some))(batch)
    torch.testing.assert_close(posed, dfd.pose(vertices, weights, batch), rtol=0, atol=0)

    jacobian = torch.func.jacrev(lambda some: dfd.pose(vertices, weights, some))(transforms)
    wanted = torch.func.jacrev(lambda some: twin(vertices, weights, some, None))(transforms)
    torch.testing.assert_close(jacobian, wanted, rtol=1e-6, atol=1e-6)

    per_pose = torch.func.vmap(torch.func.grad(lambda some: dfd.pose(vertices, weights, some).pow(2).sum()))(batch)
    for each, some in zip(per_pose, batch, strict=True):
        (alone,) = torch.func.vjp(lambda one: dfd.pose(vertices, weights, one).pow(2).sum(), some)[1](
            torch.tensor(1.0).double()
        )
        torch.testing.assert_close(each, alone)

    def height(pose):
        return torch.func.jacrev(torch.func.jacrev(lambda some: pose(some).pow(2).sum()))(transforms)

    mine = height(lambda some: dfd.pose(vertices, weights, some))
    torch.testing.assert_close(mine, height(lambda some: twin(vertices, weights, some, None)), rtol=1e-6, atol=1e-6)


@pytest.mark.filterwarnings("ignore::DeprecationWarning:torch")
def test_forward_mode_says_that_it_is_not_implemented():
    vertices, weights, transforms = (value.detach() for value in tensors())
    with pytest.raises(RuntimeError, match="jvp"):
        torch.func.jacfwd(lambda some: dfd.pose(vertices, weights, some))(transforms)


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_types_of_16_bits_are_read_and_have_gradients(dtype):
    vertices, weights, transforms = (torch.from_numpy(array) for array in scene(30, 2))
    low = vertices.to(dtype), weights.to(dtype)
    posed = dfd.pose(*low, transforms)
    assert posed.dtype == torch.float32
    assert torch.equal(posed, dfd.pose(low[0].float(), low[1].float(), transforms))
    tracked = low[1].clone().requires_grad_()
    dfd.pose(low[0], tracked, transforms).sum().backward()
    assert tracked.grad.dtype == dtype
