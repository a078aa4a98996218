"""Move vertices by blended transforms, with an optional mirror plane (Eq. 1 and 8)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dfd._core as _core
from dfd.common import check, tensors, threads
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.posing.arguments import (
    empty_like,
    handle_positions,
    handle_weight_matrix,
    read_affine,
    read_points,
    read_weights,
    target,
)
from dfd.posing.overlap import interpolating

if TYPE_CHECKING:
    import torch
    from typing_extensions import Unpack

    from dfd.symmetry.plane import SymmetryPlane

Overlap = Literal["add", "interpolate", "normalize", "paper"]
KERNEL_OVERLAPS = ("add", "paper", "normalize")  # numbered as in the kernels; "interpolate" changes the weights before
Blend = Literal["linear", "dual_quaternion"]  # numbered as in the kernels

Out = TypeVar("Out")

IDENTITY = np.eye(3, 4)
IDENTITY.flags.writeable = False


class PoseOptions(TypedDict, total=False):
    """The arguments of `pose` besides vertices, weights, transforms, `normals` and `out`."""

    default: Any
    symmetry: SymmetryPlane | None
    handles: Any
    handle_weights: Any
    overlap: Overlap
    blend: Blend


@overload
def pose(
    vertices: torch.Tensor,
    weights: Any,
    transforms: Any,
    *,
    normals: None = None,
    out: None = None,
    **how: Unpack[PoseOptions],
) -> torch.Tensor: ...
@overload
def pose(
    vertices: torch.Tensor, weights: Any, transforms: Any, *, normals: Any, **how: Unpack[PoseOptions]
) -> tuple[torch.Tensor, torch.Tensor]: ...
@overload
def pose(
    vertices: ArrayLike,
    weights: Any,
    transforms: Any,
    *,
    normals: None = None,
    out: None = None,
    **how: Unpack[PoseOptions],
) -> NDArray[Any]: ...
@overload
def pose(
    vertices: ArrayLike, weights: Any, transforms: Any, *, normals: Any, **how: Unpack[PoseOptions]
) -> tuple[NDArray[Any], NDArray[Any]]: ...
@overload
def pose(
    vertices: Any, weights: Any, transforms: Any, *, normals: None = None, out: Out, **how: Unpack[PoseOptions]
) -> Out: ...
@overload
def pose(
    vertices: Any, weights: Any, transforms: Any, *, out: Out, normals: Any, **how: Unpack[PoseOptions]
) -> tuple[Out, Any]: ...
def pose(
    vertices: Any,
    weights: Any,
    transforms: Any,
    *,
    default: Any = None,
    symmetry: SymmetryPlane | None = None,
    handles: Any = None,
    handle_weights: Any = None,
    normals: Any = None,
    overlap: Overlap = "paper",
    blend: Blend = "linear",
    out: Any = None,
) -> Any:
    """Move each vertex by the transforms of the handles that it follows.

    Parameters
    ----------
    vertices
        (V, 3) in mesh units; float32 and float64 are read in place.
    weights
        (V, H), as `dfd.bind` returns them.
    transforms
        (H, 3, 4) or (H, 4, 4) affine transforms D_k, mesh units.
    default
        (3, 4) or (4, 4) transform D₀. Its weight is 1 less the sum of all weights. The identity if left out.
    symmetry
        Plane across which handles act mirrored on the other side. Over its `band` the sides blend smoothly.
    handles
        (H,) vertex indices or (H, 3) positions of the handles. They determine the side of the plane, the weights among
        handles, and the centers of stretches with dual quaternions. If left out, a handle is at the vertex with its
        largest weight.
    handle_weights
        (H, H) weights among handles for `overlap="interpolate"`, row j at the place of handle j. The default is the
        rows of `weights` at `handles`; required if handles are at positions that are no vertices.
    normals
        (V, 3) unit normals to transform as well, by the cofactors of each vertex's blended transform.
    overlap
        The rule for weights with a sum above 1. "paper": Eq. 1 to the letter, which scales the vertex by the sum about
        the origin. "add": displacements add, so handles at rest change nothing. "normalize": weights are divided by
        their sum. "interpolate": weights are multiplied by the inverse of the weights among handles, and displacements
        add. Each handle then arrives exactly at its target, except within the band of a plane.
    blend
        The quantity that is blended. "linear": the matrices, Eq. 1. "dual_quaternion": each transform is a stretch
        about the handle's place, followed by a rigid motion. Stretches blend linearly, rigid motions as dual
        quaternions (Kavan et al., Geometric Skinning with Approximate Dual Quaternion Blending, 2008). Twisted parts
        then keep their thickness. If a transform flattens, its rigid motion does not mirror. If a transform mirrors,
        its stretch contains the mirror, along the axis that leaves the smallest rotation. If several decompositions are
        equal, any of them is used.
    out
        (V, 3) array for the result, of the type of `vertices`; a new one if left out.

    Returns
    -------
    vertices
        (V, 3) in mesh units: float32 if `vertices` is float32 or float16, else float64. A torch tensor if `vertices` is
        one. With `normals`, a pair: the vertices, and (V, 3) unit normals of the same type. If `vertices`, `weights` or
        `transforms` require gradients, the result of a linear blend has them.

    Raises ValueError if shapes disagree, a value is not finite, a transform is not affine, or `out` has another shape
    or type. Raises ValueError if two handles at one place cannot both arrive, or gradients are required where none
    exist.

    Equation 1: V' = (max(1 − Σ W_k, 0) D₀ + Σ W_k D_k) V. With "add": V' = V + max(1 − Σ W_k, 0) (D₀ V − V) + Σ W_k
    (D_k V − V). Both are equal if weights sum to at most 1. With "add", vertices stay unchanged to the bit if all
    transforms are the identity. Dual quaternions use the same sums for the differences of quaternions and stretches
    from the identity. Each quaternion has the sign of the shorter rotation from D₀, and D₀ is at the first vertex. For
    dual quaternions, "paper" is the same as "normalize".

    Equation 8: with the reflection R, handle k acts as R D_k R from its mirror image on vertices on the other side of
    the plane. Within the band, a smoothstep mixes both sides.
    """
    if tensors.tracked(vertices, weights, transforms, default, normals, handle_weights, out):
        from dfd.posing.gradients import posed_with_gradients

        options = {"symmetry": symmetry, "handles": handles, "handle_weights": handle_weights, "normals": normals}
        options |= {"default": default, "overlap": overlap, "blend": blend, "out": out}
        return posed_with_gradients(pose, vertices, weights, transforms, options)
    points = read_points("pose", vertices)
    matrix = read_weights("pose", weights, len(points))
    affine = read_affine("pose", "transforms", transforms, matrix.shape[1])
    rule = _rule("pose", points, matrix, default, symmetry, handles, handle_weights, overlap, blend)
    directions = turned = None
    if normals is not None:
        directions = check.array("pose", "normals", normals, points.shape, dtype=points.dtype, finite=False)
        turned = empty_like(points)
    posed = target("pose", out, points, {"vertices": points, "weights": matrix, "normals": directions})
    _run(rule, points, matrix, affine, posed, normals=directions, turned=turned)
    result = tensors.like(vertices, posed) if out is None else out
    return result if turned is None else (result, tensors.like(vertices, turned))


class Drag:
    """Pose repeatedly while only some handles move; the sum of all resting handles is computed once.

    Parameters are those of `dfd.pose`. `transforms` are those at the start of the drag. `moving` are the handles that
    move, as indices of columns of `weights`. With a blend other than linear, a frame costs as much as `dfd.pose`.
    """

    def __init__(
        self,
        vertices: Any,
        weights: Any,
        transforms: Any,
        moving: Any,
        *,
        default: Any = None,
        symmetry: SymmetryPlane | None = None,
        handles: Any = None,
        handle_weights: Any = None,
        overlap: Overlap = "paper",
        blend: Blend = "linear",
    ) -> None:
        """Compute the sum of the resting handles.

        Raises ValueError as `dfd.pose` does, or if `moving` is out of range or contains a handle twice.
        """
        if tensors.tracked(vertices, weights, transforms, default, handle_weights):
            raise ValueError("Drag: a drag has no gradients: detach the tensors that require them")
        self._points = read_points("Drag", vertices).copy()
        matrix = read_weights("Drag", weights, len(self._points))
        affine = read_affine("Drag", "transforms", transforms, matrix.shape[1])
        self._moving = check.vertex_indices("Drag", "moving", np.atleast_1d(moving), matrix.shape[1], unique=True)
        rule = _rule("Drag", self._points, matrix, default, symmetry, handles, handle_weights, overlap, blend)
        self._like = vertices if tensors.is_tensor(vertices) else None
        self._base: NDArray[Any] | None = None
        if blend != "linear":
            self._rule, self._weights, self._transforms = rule, matrix.copy(order="K"), affine.copy()
            return
        # Handles at rest add nothing, so posing with the moving handles at rest gives the base.
        resting = affine.copy()
        resting[self._moving] = IDENTITY
        self._base = empty_like(self._points)
        _run(rule, self._points, matrix, resting, self._base)
        self._weights = np.asfortranarray(_effective(rule, matrix, self._moving), np.float32)
        positive = None if rule.positive is None else np.ascontiguousarray(rule.positive[self._moving])
        self._rule = replace(rule, rest=IDENTITY, positive=positive, places=None, mixing=None, overlap="add")

    def pose(self, transforms: Any, *, out: Any = None) -> Any:
        """Return vertices (V, 3) with `transforms` (M, 3, 4) or (M, 4, 4) of the moving handles, in their order.

        Raises ValueError as `dfd.pose` does.
        """
        if tensors.tracked(transforms, out):
            raise ValueError("Drag.pose: a drag has no gradients: detach the tensors that require them")
        affine = read_affine("Drag.pose", "transforms", transforms, len(self._moving))
        posed = target("Drag.pose", out, self._points, {"vertices": self._points, "base": self._base})
        if self._base is None:
            self._transforms[self._moving] = affine
            affine = self._transforms
        _run(self._rule, self._points, self._weights, affine, posed, base=self._base)
        return tensors.like(self._like, posed) if out is None else out


@dataclass(frozen=True)
class _Rule:
    """The rule for blending transforms, as the kernel takes it."""

    rest: Float64  # (3, 4) D₀
    plane: tuple[tuple[float, float, float], float, float] | None
    positive: Bool | None  # (H,) which handles are on the side to which the plane's normal points
    places: Float64 | None  # (H, 3) positions of the handles
    mixing: Float64 | None  # (H, H) matrix by which the weights are multiplied
    overlap: Overlap
    blend: Blend


def _rule(
    function: str,
    points: NDArray[Any],
    weights: Float32,
    default: Any,
    symmetry: SymmetryPlane | None,
    handles: Any,
    handle_weights: Any,
    overlap: Overlap,
    blend: Blend,
) -> _Rule:
    check.choice(function, "overlap", overlap, Overlap)
    check.choice(function, "blend", blend, Blend)
    if symmetry is not None:
        from dfd.symmetry.plane import SymmetryPlane

        if not isinstance(symmetry, SymmetryPlane):
            raise ArgumentError("symmetry", f"must be a SymmetryPlane, got {type(symmetry).__name__}", function)
    rest = IDENTITY if default is None else read_affine(function, "default", default, None)[0]
    indices = places = positive = mixing = None
    if symmetry is not None or blend != "linear" or overlap == "interpolate":
        indices, places = handle_positions(function, handles, points, weights)
    if symmetry is not None:
        assert places is not None
        positive = places @ np.asarray(symmetry.normal, np.float64) - symmetry.offset >= 0
    if overlap == "interpolate":
        mixing = np.ascontiguousarray(
            interpolating(function, handle_weight_matrix(function, handle_weights, weights, indices))
        )
    plane = None if symmetry is None else (symmetry.normal, symmetry.offset, symmetry.band)
    return _Rule(rest, plane, positive, None if blend == "linear" else places, mixing, overlap, blend)


def _run(
    rule: _Rule,
    points: NDArray[Any],
    weights: Float32,
    transforms: Float64,
    posed: NDArray[Any],
    *,
    base: NDArray[Any] | None = None,
    normals: NDArray[Any] | None = None,
    turned: NDArray[Any] | None = None,
) -> None:
    _core.pose(
        points,
        weights,
        transforms,
        rule.rest,
        rule.plane,
        rule.positive,
        rule.places,
        rule.mixing,
        0 if rule.overlap == "interpolate" else KERNEL_OVERLAPS.index(rule.overlap),
        get_args(Blend).index(rule.blend),
        base,
        normals,
        posed,
        turned,
        threads.get_num_threads(),
    )


def _effective(rule: _Rule, weights: Float32, moving: Int64) -> NDArray[Any]:
    """Return the weights (V, M) of the `moving` handles' displacements."""
    if rule.mixing is not None:
        return weights @ rule.mixing[:, moving].astype(np.float32)
    if rule.overlap == "normalize":
        return weights[:, moving] / np.maximum(weights.sum(axis=1, dtype=np.float64), 1.0)[:, None]
    return weights[:, moving]
