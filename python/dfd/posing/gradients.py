"""Differentiate a linear blend (Eq. 1 and 8). The kernel computes the forward pass, and torch the backward pass."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from dfd.common import tensors
from dfd.common.errors import ArgumentError
from dfd.posing.arguments import handle_positions, read_affine

if TYPE_CHECKING:
    from dfd.symmetry.plane import SymmetryPlane


def posed_with_gradients(
    pose: Callable[..., Any], vertices: Any, weights: Any, transforms: Any, options: dict[str, Any]
) -> Any:
    """Return the result of `pose` as a tensor with gradients for `vertices`, `weights` and `transforms`.

    Raises ValueError as `dfd.pose` does, if another argument requires gradients, or if the blend has no gradients.
    """
    for name in ("default", "normals", "handle_weights", "out"):
        if tensors.tracked(options[name]):
            raise ArgumentError(name, "has no gradient: detach it", "pose")
    if options["normals"] is not None or options["out"] is not None:
        name = "normals" if options["normals"] is not None else "out"
        raise ArgumentError(name, "must not be given with tensors that require gradients: detach them", "pose")
    if options["blend"] != "linear" or options["overlap"] == "interpolate":
        remedy = "detach the tensors that require gradients"
        raise ValueError(f'pose: only blend="linear" without overlap="interpolate" has gradients: {remedy}')
    inputs = []
    for name, value in {"vertices": vertices, "weights": weights, "transforms": transforms}.items():
        if tensors.tracked(value) and value.dtype not in (torch.float32, torch.float64):
            raise ArgumentError(name, f"must be float32 or float64 to have gradients, got {value.dtype}", "pose")
        if not isinstance(value, torch.Tensor):
            array = np.asarray(tensors.shared("pose", name, value))
            # The vertices of a mesh are read-only. torch has no read-only tensors, and would warn without the copy.
            value = torch.from_numpy(array if array.flags.writeable else array.copy())
        inputs.append(value)
    return _Pose.apply(pose, options, *inputs)  # type: ignore[no-untyped-call]


class _Pose(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, pose: Callable[..., Any], options: dict[str, Any], *inputs: torch.Tensor) -> torch.Tensor:
        ctx.save_for_backward(*inputs)
        ctx.options = options
        return pose(*(value.detach() for value in inputs), **options)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        with torch.enable_grad():
            needed = ctx.needs_input_grad
            inputs = [saved.detach().requires_grad_(needed[2 + k]) for k, saved in enumerate(ctx.saved_tensors)]
            vertices, weights, transforms = (value.to(torch.float64) for value in inputs)
            posed = _posed(vertices, weights, transforms, ctx.options)
        wanted = [value for value in inputs if value.requires_grad]
        found = iter(torch.autograd.grad(posed, wanted, gradient.to(torch.float64), allow_unused=True))
        return None, None, *(next(found) if value.requires_grad else None for value in inputs)


def _posed(
    vertices: torch.Tensor, weights: torch.Tensor, transforms: torch.Tensor, options: dict[str, Any]
) -> torch.Tensor:
    """Return the vertices (V, 3) of Eq. 1 and 8, computed by torch in float64."""
    rest = torch.eye(3, 4, dtype=torch.float64)
    if options["default"] is not None:
        rest = torch.from_numpy(read_affine("pose", "default", options["default"], None)[0])
    total = weights.sum(dim=1, keepdim=True)
    excess = torch.clamp(total - 1, min=0) if options["overlap"] == "paper" else torch.zeros_like(total)
    if options["overlap"] == "normalize":
        weights = weights / torch.clamp(total, min=1)
    remainder = torch.clamp(1 - total, min=0)

    def moved(affine: torch.Tensor) -> torch.Tensor:
        changes = torch.cat([affine, rest[None]]) - torch.eye(3, 4, dtype=torch.float64)
        blended = torch.einsum("vh,hij->vij", torch.cat([weights, remainder], dim=1), changes)
        shift = torch.einsum("vij,vj->vi", blended[:, :, :3], vertices) + blended[:, :, 3]
        return vertices * (1 + excess) + shift

    affine = transforms[:, :3]
    plane: SymmetryPlane | None = options["symmetry"]
    if plane is None:
        return moved(affine)
    normal = torch.tensor(plane.normal, dtype=torch.float64)
    given = vertices.detach().numpy(), weights.detach().float().numpy()
    _, places = handle_positions("pose", options["handles"], *given)
    positive = torch.from_numpy(places @ np.asarray(plane.normal) >= plane.offset)[:, None, None]
    reflection = torch.from_numpy(plane.reflection)
    bottom = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64).expand(len(affine), 1, 4)
    other = (reflection @ torch.cat([affine, bottom], dim=1) @ reflection)[:, :3]
    height = vertices @ normal - plane.offset
    if plane.band > 0:
        t = torch.clamp(height / (2 * plane.band) + 0.5, 0, 1)
        share = t * t * (3 - 2 * t)
    else:
        share = (height >= 0).to(torch.float64)
    above, below = moved(torch.where(positive, affine, other)), moved(torch.where(positive, other, affine))
    return share[:, None] * above + (1 - share[:, None]) * below
