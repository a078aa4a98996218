"""Differentiate weights (Eq. 4 to 7). The kernel computes the weights, and torch their derivatives, in float64."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch

from dfd.common import tensors
from dfd.common.check import vertex_indices
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32
from dfd.weights.compact import CompactFeatures
from dfd.weights.regions import items_of

ROWS = 16_384  # number of vertices that are differentiated together, which limits the memory
SAME = 1e-12  # squared feature distances below this multiple of the squared lengths count as 0
# Arguments of `_Bind` that torch may differentiate, in their order.
INPUTS = ("features", "handles", "fixed", "strength", "geodesic", "locality", "reach")


def bound_with_gradients(bind: Callable[..., Float32], given: dict[str, Any], falloff: Any) -> torch.Tensor:
    """Return weights (V, H) as a tensor with gradients for those arguments in `given` that require them.

    `bind` computes weights of arrays. `given` has the arguments of `dfd.bind`, except `falloff`.

    Raises ValueError as `dfd.bind` does, or if `out` is given, features are compact or handles are regions.
    """
    if given.pop("out") is not None:
        raise ArgumentError("out", "must not be given with tensors that require gradients: detach them", "bind")
    if isinstance(given["features"], CompactFeatures):
        raise ArgumentError("features", "must not be compact to have gradients: give the full features", "bind")
    for name in ("handles", "fixed"):
        if items_of(name, given[name]) is not None:
            raise ArgumentError(name, "must be vertices or feature rows to have gradients, not regions", "bind")
    values = [tensors.as_tensor("bind", name, given[name]) for name in INPUTS]
    for k in (1, 2):
        if values[k] is not None and values[k].ndim == 1:
            values[k] = torch.from_numpy(vertex_indices("bind", INPUTS[k], values[k], len(values[0])))
    return _Bind.apply(_Call(bind, falloff), *values)  # type: ignore[no-untyped-call]


class _Call:
    """The function and the falloffs of one call of `dfd.bind`, which torch does not differentiate."""

    def __init__(self, bind: Callable[..., Float32], falloff: Any) -> None:
        self.bind, self.falloff = bind, falloff


class _Bind(torch.autograd.Function):
    """Bind with the kernel."""

    @staticmethod
    def forward(call: _Call, *inputs: torch.Tensor | None) -> torch.Tensor:
        arrays = [None if value is None else value.detach() for value in inputs]
        given = {name: value for name, value in zip(INPUTS, arrays, strict=True) if value is not None}
        return torch.from_numpy(call.bind(**given, falloff=call.falloff))

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
        ctx.call = inputs[0]
        ctx.save_for_backward(*inputs[1:])

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        features, handles, fixed, strength, geodesic, locality, reach = ctx.saved_tensors
        found: list[Any] = [None] * len(INPUTS)
        pieces: list[list[torch.Tensor]] = [[], []]  # gradients of the rows of features and of geodesic
        rows = [each if each is None or each.ndim == 2 else features[each] for each in (handles, fixed)]
        for start in range(0, max(len(features), 1), ROWS):
            some = slice(start, start + ROWS)
            near = None if geodesic is None else geodesic[:, some]
            inputs = [features[some], *rows, strength, near, locality, reach]
            for k, part in enumerate(_pulled(ctx.call.falloff, gradient[some], inputs)):
                if part is None:
                    continue
                if k in (0, 4):
                    pieces[k // 4].append(part)
                else:
                    found[k] = part if found[k] is None else found[k] + part
        found[0] = torch.cat(pieces[0])
        found[4] = torch.cat(pieces[1], dim=1) if pieces[1] else None
        for k, points in ((1, handles), (2, fixed)):  # a vertex moves the feature from which distances are measured
            if points is not None and points.ndim == 1:
                found[0] = found[0].index_add(0, points, found[k].to(found[0].dtype))
                found[k] = None
        return None, *(value if needed else None for value, needed in zip(found, ctx.needs_input_grad[1:], strict=True))

    @staticmethod
    def vmap(info: Any, in_dims: tuple[Any, ...], call: _Call, *inputs: Any) -> tuple[torch.Tensor, int]:
        calls = tensors.unbatched(info.batch_size, in_dims[1:], inputs)
        return torch.stack([_Bind.apply(call, *each) for each in calls]), 0  # type: ignore[no-untyped-call]


def _pulled(falloff: Any, gradient: torch.Tensor, inputs: Sequence[torch.Tensor | None]) -> list[torch.Tensor | None]:
    """Return the gradients of the `inputs` of `_weights`, for the `gradient` (V, H) of the weights."""
    present = [k for k, value in enumerate(inputs) if value is not None and value.is_floating_point()]

    def weights(*some: torch.Tensor) -> torch.Tensor:
        values = list(inputs)
        for k, value in zip(present, some, strict=True):
            values[k] = value
        return _weights(falloff, *(None if value is None else value.double() for value in values))

    given = [value for k, value in enumerate(inputs) if k in present and value is not None]
    found: Sequence[torch.Tensor]
    if torch.is_grad_enabled() or tensors.tracked(gradient, *given):
        found = torch.func.vjp(weights, *given)[1](gradient.double())
    else:  # the first call of `torch.func.vjp` imports modules for a second
        with torch.enable_grad():
            leaves = [value.detach().requires_grad_() for value in given]
            outputs = weights(*leaves)
        found = torch.autograd.grad(outputs, leaves, gradient.double(), materialize_grads=True)
    result: list[torch.Tensor | None] = [None] * len(inputs)
    for k, value in zip(present, found, strict=True):
        result[k] = value
    return result


def _weights(
    falloff: Any,
    features: torch.Tensor | None,
    handles: torch.Tensor | None,
    fixed: torch.Tensor | None,
    strength: torch.Tensor | None,
    geodesic: torch.Tensor | None,
    locality: torch.Tensor | None,
    reach: torch.Tensor | None,
) -> torch.Tensor:
    """Return the weights (V, H) of Eq. 4 to 7, computed by torch. Points are feature rows."""
    assert features is not None
    assert handles is not None
    x = torch.relu(1 - _distances(features, handles) / (1.0 if reach is None else reach))
    names = [falloff] * len(handles) if isinstance(falloff, str) else list(falloff)
    weights = (
        x
        if set(names) <= {"linear"}
        else torch.stack([_FALLOFFS[name](x[:, k]) for k, name in enumerate(names)], dim=1)
    )
    if fixed is not None and len(fixed):
        held = torch.relu(1 - _distances(features, fixed)) * (1.0 if strength is None else strength)
        weights = torch.relu(weights - held.amax(dim=1, keepdim=True))
    if geodesic is not None and locality is not None:
        weights = weights * torch.pow(torch.clamp(1 - geodesic.T, min=0), locality)
    return weights


def _distances(features: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
    """Return the feature distances (V, H). Where a distance is 0, it has no derivative, and its gradient is 0."""
    lengths = features.square().sum(dim=1)[:, None] + rows.square().sum(dim=1)
    squares = lengths - 2 * features @ rows.T
    apart = squares > SAME * lengths
    return torch.where(apart, torch.where(apart, squares, 1.0).sqrt(), 0.0)


def _root(x: torch.Tensor) -> torch.Tensor:
    """Return √x for x ≥ 0, with the gradient 0 at 0."""
    return torch.where(x > 0, torch.where(x > 0, x, 1.0).sqrt(), 0.0)


_FALLOFFS: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "linear": lambda x: x,
    "smooth": lambda x: x * x * (3 - 2 * x),
    "sharp": torch.square,
    "root": _root,
    "sphere": lambda x: _root(x * (2 - x)),
    "constant": lambda x: 0 * x + (x > 0),
}
