"""Differentiate a linear blend (Eq. 1 and 8): kernels compute the posed vertices and their first derivatives.

Second derivatives and those of higher order are computed by torch, from a copy of the equations in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

import dfd._core as _core
from dfd.common import tensors, threads
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32

if TYPE_CHECKING:
    from dfd.symmetry.plane import SymmetryPlane

INPUTS = ("vertices", "weights", "transforms", "default")


def posed_with_gradients(
    pose: Callable[..., tuple[NDArray[Any], Any]],
    prepare: Callable[..., Any],
    vertices: Any,
    weights: Any,
    transforms: Any,
    options: dict[str, Any],
) -> torch.Tensor:
    """Return the posed vertices as a tensor with gradients for `vertices`, `weights`, `transforms` and the default.

    `pose` poses arrays, and `prepare` checks the arguments and converts them for the kernels.

    Raises ValueError as `dfd.pose` does, if another argument requires gradients, or if the blend has no gradients.
    """
    for name in ("normals", "handle_weights", "out"):
        if tensors.tracked(options[name]):
            raise ArgumentError(name, "has no gradient: detach it", "pose")
    if options["normals"] is not None or options["out"] is not None:
        name = "normals" if options["normals"] is not None else "out"
        raise ArgumentError(name, "must not be given with tensors that require gradients: detach them", "pose")
    if options["blend"] != "linear" or options["overlap"] == "interpolate":
        remedy = "detach the tensors that require gradients"
        raise ValueError(f'pose: only blend="linear" without overlap="interpolate" has gradients: {remedy}')
    how = {name: options[name] for name in ("symmetry", "handles", "overlap")}
    given = zip(INPUTS, (vertices, weights, transforms, options["default"]), strict=True)
    call = _Call(pose, prepare, how)
    return _Pose.apply(call, *(tensors.as_tensor("pose", name, value) for name, value in given))  # type: ignore[no-untyped-call]


class _Call:
    """The functions and options of one call of `dfd.pose`, which torch does not differentiate."""

    def __init__(
        self, pose: Callable[..., tuple[NDArray[Any], Any]], prepare: Callable[..., Any], how: dict[str, Any]
    ) -> None:
        self.pose, self.prepare, self.how = pose, prepare, how


class _Pose(torch.autograd.Function):
    """Pose with the kernel."""

    @staticmethod
    def forward(
        call: _Call, vertices: torch.Tensor, weights: torch.Tensor, transforms: torch.Tensor, default: Any
    ) -> torch.Tensor:
        inputs = [None if value is None else value.detach() for value in (vertices, weights, transforms, default)]
        return torch.from_numpy(call.pose(*inputs, **call.how)[0])

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
        ctx.call = inputs[0]
        ctx.save_for_backward(*inputs[1:])

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        wanted = ctx.needs_input_grad[1:]
        found = iter(_PoseGradients.apply(ctx.call, wanted, gradient, *ctx.saved_tensors))  # type: ignore[no-untyped-call]
        return None, *(next(found) if each else None for each in wanted)

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], call: _Call, *inputs: Any) -> tuple[torch.Tensor, int]:
        posed = [_Pose.apply(call, *each) for each in tensors.unbatched(info.batch_size, in_dims[1:], inputs)]  # type: ignore[no-untyped-call]
        return torch.stack(posed), 0


class _PoseGradients(torch.autograd.Function):
    """Compute the gradients of `_Pose` that are `wanted` with the kernel."""

    @staticmethod
    def forward(
        call: _Call,
        wanted: tuple[bool, ...],
        gradient: torch.Tensor,
        vertices: torch.Tensor,
        weights: torch.Tensor,
        transforms: torch.Tensor,
        default: Any,
    ) -> tuple[torch.Tensor, ...]:
        inputs = [None if value is None else value.detach() for value in (vertices, weights, transforms, default)]
        points, matrix, affine, _, rule = call.prepare(*inputs, **call.how)
        steps = np.ascontiguousarray(gradient.detach().numpy(), points.dtype).reshape(len(affine), *points.shape)
        plane = rule.rest, rule.plane, rule.positive, rule.overlap
        sums: list[Any] = [None] * len(INPUTS)
        of_affine = np.zeros(affine.shape) if wanted[2] else None
        for k, (step, each) in enumerate(zip(steps, affine, strict=True)):
            outputs = (
                np.empty_like(points) if wanted[0] else None,
                _like_weights(matrix, points.dtype) if wanted[1] else None,
                None if of_affine is None else of_affine[k],
                np.empty((3, 4)) if wanted[3] else None,
            )
            _core.pose_gradients(step, points, matrix, each, *plane, *outputs, threads.get_num_threads())
            sums = [new if old is None else old + new for old, new in zip(sums, outputs, strict=True)]
        sums[2] = of_affine
        found: list[torch.Tensor] = []
        for array, given, needed in zip(sums, inputs, wanted, strict=True):
            if needed and given is not None:
                found.append(torch.zeros_like(given) if array is None else _as_given(array, given))
        return tuple(found)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: tuple[torch.Tensor, ...]) -> None:
        ctx.call, ctx.wanted = inputs[:2]
        ctx.save_for_backward(*inputs[2:])

    @staticmethod
    def backward(ctx: Any, *further: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        saved: tuple[Any, ...] = ctx.saved_tensors
        present = [k for k, value in enumerate(saved) if value is not None]

        def gradients(*values: torch.Tensor) -> tuple[torch.Tensor, ...]:
            given: list[Any] = [None] * len(saved)
            for k, value in zip(present, values, strict=True):
                given[k] = value
            chosen = [k for k, each in enumerate(ctx.wanted) if each]

            def posed(*some: torch.Tensor) -> torch.Tensor:
                inputs = list(given[1:])
                for k, value in zip(chosen, some, strict=True):
                    inputs[k] = value
                return _posed(*inputs, **ctx.call.how).to(given[0].dtype)

            found: tuple[torch.Tensor, ...] = torch.func.vjp(posed, *(given[1 + k] for k in chosen))[1](given[0])
            return found

        pulled = torch.func.vjp(gradients, *(saved[k] for k in present))[1](further)
        result: list[torch.Tensor | None] = [None] * len(saved)
        for k, value in zip(present, pulled, strict=True):
            result[k] = value
        return None, None, *result

    @staticmethod
    def vmap(
        info: Any, in_dims: tuple[Any, ...], call: _Call, wanted: tuple[bool, ...], *inputs: Any
    ) -> tuple[tuple[torch.Tensor, ...], tuple[int, ...]]:
        calls = tensors.unbatched(info.batch_size, in_dims[2:], inputs)
        found = [_PoseGradients.apply(call, wanted, *each) for each in calls]  # type: ignore[no-untyped-call]
        stacked = tuple(torch.stack(each) for each in zip(*found, strict=True))
        return stacked, (0,) * len(stacked)


def _like_weights(weights: Float32, dtype: Any) -> NDArray[Any]:
    """Return a new uninitialized array for the gradient of `weights` (V, H), with the same contiguous lines."""
    empty = _core.empty_float32 if dtype == np.float32 else _core.empty_float64
    rows, columns = weights.shape
    return empty(rows, columns) if weights.flags.c_contiguous else empty(columns, rows).T


def _as_given(array: NDArray[Any], given: torch.Tensor) -> torch.Tensor:
    """Return a gradient with the shape and type of the argument. The bottom rows of (4, 4) matrices have none."""
    found = torch.from_numpy(array).to(given.dtype)
    if found.shape == given.shape:
        return found
    result = torch.zeros_like(given)
    result[..., :3, :] = found.reshape(*given.shape[:-2], 3, 4)
    return result


def _posed(
    vertices: torch.Tensor,
    weights: torch.Tensor,
    transforms: torch.Tensor,
    default: torch.Tensor | None,
    *,
    symmetry: SymmetryPlane | None,
    handles: Any,
    overlap: str,
) -> torch.Tensor:
    """Return the vertices (…, V, 3) of Eq. 1 and 8, computed by torch in float64.

    Where the sum of the weights is exactly 1, the derivatives are those for smaller sums, as in the kernel.
    """
    vertices, weights, transforms = (value.to(torch.float64) for value in (vertices, weights, transforms))
    identity = torch.eye(3, 4, dtype=torch.float64)
    rest = identity if default is None else default.to(torch.float64).reshape(-1, 4)[:3]
    total = weights.sum(dim=1, keepdim=True)
    over, zero = total > 1, torch.zeros_like(total)
    excess = torch.where(over, total - 1, zero) if overlap == "paper" else zero
    if overlap == "normalize":
        weights = weights / torch.where(over, total, torch.ones_like(total))
    remainder = torch.where(over, zero, 1 - total)

    def moved(affine: torch.Tensor) -> torch.Tensor:
        blended = torch.einsum("vh,...hij->...vij", weights, affine - identity)
        blended = blended + remainder[:, :, None] * (rest - identity)
        shift = torch.einsum("...vij,vj->...vi", blended[..., :3], vertices) + blended[..., 3]
        return vertices * (1 + excess) + shift

    affine = transforms[..., :3, :]
    if symmetry is None:
        return moved(affine)
    normal = torch.tensor(symmetry.normal, dtype=torch.float64)
    if handles is None:
        places = vertices[weights.argmax(dim=0)] if len(vertices) else vertices.new_zeros((weights.shape[1], 3))
    else:
        array = np.asarray(tensors.shared("pose", "handles", handles))
        places = torch.from_numpy(array.astype(np.float64)) if array.ndim == 2 else vertices[torch.from_numpy(array)]
    positive = (places @ normal >= symmetry.offset)[:, None, None]
    reflection = torch.from_numpy(symmetry.reflection)
    other = reflection[:3, :3] @ affine @ reflection
    other = other + torch.nn.functional.pad(reflection[:3, 3:], (3, 0))
    height = vertices @ normal - symmetry.offset
    if symmetry.band > 0:
        t = torch.clamp(height / (2 * symmetry.band) + 0.5, 0, 1)
        share = t * t * (3 - 2 * t)
    else:
        share = (height >= 0).to(torch.float64)
    above, below = moved(torch.where(positive, affine, other)), moved(torch.where(positive, other, affine))
    return share[:, None] * above + (1 - share[:, None]) * below
