"""Compute the weight of each vertex for each handle, from feature distances, fixed points and locality (Eq. 4-7)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike

import dfd._core as _core
from dfd.common import check, tensors, threads
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Int32
from dfd.weights.compact import CompactFeatures
from dfd.weights.regions import Targets, resolve_points

if TYPE_CHECKING:
    import torch
    from typing_extensions import Unpack

Falloff = Literal["linear", "smooth", "sharp", "root", "sphere", "constant"]  # numbered as in the kernels

Out = TypeVar("Out")


class BindOptions(TypedDict, total=False):
    """The arguments of `bind`, except `features`, `handles` and `out`."""

    fixed: Any
    strength: ArrayLike | None
    geodesic: Any
    locality: ArrayLike
    reach: ArrayLike
    falloff: Falloff | Sequence[Falloff]


@overload
def bind(features: torch.Tensor, handles: Any, *, out: None = None, **how: Unpack[BindOptions]) -> torch.Tensor: ...
@overload
def bind(
    features: ArrayLike | CompactFeatures, handles: Any, *, out: None = None, **how: Unpack[BindOptions]
) -> Float32: ...
@overload
def bind(features: Any, handles: Any, *, out: Out, **how: Unpack[BindOptions]) -> Out: ...
def bind(
    features: Any,
    handles: Any,
    *,
    fixed: Any = None,
    strength: ArrayLike | None = None,
    geodesic: Any = None,
    locality: ArrayLike = 0.0,
    reach: ArrayLike = 1.0,
    falloff: Falloff | Sequence[Falloff] = "linear",
    out: Any = None,
) -> Any:
    """Return the weight of each vertex for each handle, in [0, 1].

    Without fixed points, the weight at a handle itself is 1.

    Raises ValueError if array shapes disagree, a value is not finite, an index is out of range or repeated, or a region
    is empty. Raises ValueError if a distance or strength lies outside [0, 1], a reach is not above 0, an array is
    masked, or `out` has another array shape or type. If a tensor requires gradients, raises ValueError for regions,
    compact features and a given `out`.

    If a tensor requires gradients, so do the weights: all arguments but `falloff` and vertex indices have gradients, of
    any order. The feature distance has no derivative where it is 0, at the handle itself; its gradient counts as 0
    there. Beyond the reach, weights are 0, and so are their gradients: a vertex there does not learn to follow.

    Equations 4 and 5: W_ij = f(max(1 − ‖Z_i − Z_j‖ / r, 0)) for vertex i, handle j and features Z; in the paper, r = 1
    and f(x) = x. Then Equation 6: W_ij ← max(W_ij − max_p s_p W_ip, 0) for the fixed points p, with
    W_ip = max(1 − ‖Z_i − Z_p‖, 0); in the paper, s = 1. Then Equation 7: W_ij ← W_ij (1 − G_ji)^λ, with G = `geodesic`.

    Parameters
    ----------
    features
        (V, D) feature rows, usually of unit length; they are not normalized. float32 is read in place. They may also be
        compact features, with which binding is many times faster. The weights then change by at most the tolerance that
        `dfd.compact` was given.
    handles
        (H,) distinct vertex indices, a mask (V,) of bool, or (H, D) feature rows for points in space. Negative indices
        count from the end. A sequence of H items also permits regions: each item is a vertex index, a list of vertex
        indices, or (N, D) rows. The weight of a vertex for a region depends on the member of the region with the most
        similar feature. At most 32 members are used, whose features differ most from each other, and by more than
        0.001. They are chosen from at most 8,192 members, taken at equal intervals from the list.
    fixed
        Points or regions that stay in place: (P,), (P, D) or a sequence of P items, as for `handles`. Surface with
        similar features stays, too.
    strength
        Factors s in [0, 1]: one number, or (P,). Eq. 6 subtracts the weights of each fixed point, multiplied by its s.
        None stands for 1.
    geodesic
        (H, V) distances G along the surface from each handle, in [0, 1]. float32 is read in place.
    locality
        The exponent λ ≥ 0 of Eq. 7: one number, or (H,). 0 ignores `geodesic`. A larger λ lowers the weights of
        distant vertices more.
    reach
        The feature distance r > 0 at which the weight is 0: one number, or (H,). Unit rows have a distance of at most
        2, so a reach above 2 includes all vertices.
    falloff
        The curve f(x) with x = 1 − d / r, where d is the feature distance: one name, or H names. "linear": x,
        "smooth": x² (3 − 2x), "sharp": x², "root": √x, "sphere": √(x (2 − x)), "constant": 1 if x > 0. Blender's
        proportional editing uses the same names.
    out
        (V, H) float32 array for the result, with contiguous rows or columns; None makes a new array.

    Returns
    -------
    weights
        (V, H) float32; a torch tensor if `features` is one.

    Examples
    --------
    The first two vertices have nearly equal features, and the third has another feature:

    >>> import dfd
    >>> import numpy as np
    >>> features = np.array([[1, 0], [0.8, 0.6], [0, 1]], np.float32)
    >>> dfd.bind(features, [0]).round(3)
    array([[1.   ],
           [0.368],
           [0.   ]], dtype=float32)
    """
    given = {"handles": handles, "fixed": fixed, "strength": strength, "geodesic": geodesic}
    given |= {"locality": locality, "reach": reach, "out": out}
    if tensors.tracked(features, *given.values()):
        from dfd.weights.gradients import bound_with_gradients

        return bound_with_gradients(_bound, {"features": features, **given}, falloff)
    weights = _bound(features, falloff=falloff, **given)
    return tensors.like(features, weights) if out is None else out


def _bound(
    features: Any,
    handles: Any,
    *,
    falloff: Falloff | Sequence[Falloff],
    fixed: Any = None,
    strength: ArrayLike | None = None,
    geodesic: Any = None,
    locality: ArrayLike = 0.0,
    reach: ArrayLike = 1.0,
    out: Any = None,
) -> Float32:
    """Return the weights (V, H), in `out` if it is given. The arguments are those of `bind`."""
    source: Float32 | CompactFeatures
    if isinstance(features, CompactFeatures):
        source, blocks, step = features, features.blocks, features.step
    else:
        source = blocks = check.array("bind", "features", features, ("V", "D"), finite=False)
        step = 1.0
        if source.shape[1] == 0 and len(source):
            raise ArgumentError("features", f"must have at least one dimension, got {source.shape}", "bind")
    wanted = resolve_points("handles", handles, source)
    held = None if fixed is None else resolve_points("fixed", fixed, source)
    fixed_points, fixed_offsets = (None, None) if held is None else (held.points, held.offsets)
    shape = (source.shape[0], len(wanted))
    distances, exponents = _locality(geodesic, locality, shape)
    reaches, falloffs = _extents(reach, falloff, shape[1])
    if out is None:
        weights = _core.empty_float32(*shape)
    else:
        inputs = {"features": blocks, "handles": wanted.points, "geodesic": distances}
        inputs["fixed"] = fixed_points
        weights = tensors.output("bind", out, shape, np.float32, inputs, columns=True)
    _core.bind(
        blocks,
        shape[0],
        step,
        wanted.points,
        wanted.offsets,
        wanted.members,
        reaches,
        falloffs,
        fixed_points,
        fixed_offsets,
        _strengths(strength, held),
        distances,
        exponents,
        weights,
        threads.get_num_threads(),
    )
    return weights


def _strengths(strength: ArrayLike | None, held: Targets | None) -> Float32 | None:
    """Return the strength (N,) of each fixed point or member of a fixed region; None if `strength` is None."""
    if strength is None:
        return None
    if held is None:
        raise ArgumentError("fixed", "must be given when `strength` is", "bind")
    strengths = _for_each("strength", strength, len(held), minimum=0.0)
    if (strengths > 1).any():
        raise ArgumentError("strength", f"must be at most 1, got {strengths.max():g}", "bind")
    return strengths if held.members is None else np.repeat(strengths, held.members)


def _extents(
    reach: ArrayLike, falloff: Falloff | Sequence[Falloff], handle_count: int
) -> tuple[Float32 | None, Int32 | None]:
    """Return the reaches (H,) and the indices of the falloffs (H,); (None, None) if all are 1 and "linear"."""
    if type(reach) is float and reach == 1.0 and falloff == "linear":
        return None, None
    reaches = _for_each("reach", reach, handle_count, minimum=0.0, exclusive=True)
    if not isinstance(falloff, str | Sequence):
        raise ArgumentError("falloff", f"must be one name or a list of names, got {falloff!r}", "bind")
    names = [falloff] if isinstance(falloff, str) else list(falloff)
    numbers = [get_args(Falloff).index(check.choice("bind", "falloff", name, Falloff)) for name in names]
    if isinstance(falloff, str):
        numbers *= handle_count
    if len(numbers) != handle_count:
        raise ArgumentError("falloff", f"must be one name or {handle_count}, got {len(numbers)}", "bind")
    return reaches, np.array(numbers, np.int32)


def _locality(geodesic: Any, locality: ArrayLike, shape: tuple[int, int]) -> tuple[Float32 | None, Float32 | None]:
    """Return the distances (H, V) and exponents λ (H,), or (None, None) without locality."""
    if geodesic is None and type(locality) is float and locality == 0:
        return None, None
    vertex_count, handle_count = shape
    exponents = _for_each("locality", locality, handle_count, minimum=0.0)
    if geodesic is None:
        if exponents.any():
            raise ArgumentError("geodesic", "must be given when `locality` is above 0", "bind")
        return None, None
    return check.array("bind", "geodesic", geodesic, (handle_count, vertex_count), finite=False), exponents


def _for_each(name: str, value: ArrayLike, count: int, *, minimum: float, exclusive: bool = False) -> Float32:
    """Return `value`, which is one number or `count` numbers, as an array (count,)."""
    if np.ndim(tensors.shared("bind", name, value)) == 0:
        number = check.number("bind", name, value, minimum=minimum, exclusive=exclusive)
        numbers = np.full(count, np.clip(number, 0, np.finfo(np.float32).max), np.float32)
    else:
        numbers = check.array("bind", name, value, (count,))
        if (numbers < minimum).any() or (exclusive and (numbers == minimum).any()):
            bound = "above" if exclusive else "at least"
            raise ArgumentError(name, f"must be {bound} {minimum:g}, got {numbers.min():g}", "bind")
    return np.maximum(numbers, np.finfo(np.float32).tiny) if exclusive else numbers  # above 0 even as float32
