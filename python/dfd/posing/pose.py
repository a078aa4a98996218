"""Vertices moved by blended transforms, across a mirror plane when there is one (Eq. 1 and 8)."""

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
KERNEL_OVERLAPS = ("add", "paper", "normalize")  # numbered as in the kernels; interpolating weights are made before
Blend = Literal["linear", "dual_quaternion"]  # numbered as in the kernels

Out = TypeVar("Out")

IDENTITY = np.eye(3, 4)
IDENTITY.flags.writeable = False


class PoseOptions(TypedDict, total=False):
    """What `pose` takes besides vertices, weights, transforms, `normals` and `out`."""

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
        (V, H), what `dfd.bind` returns.
    transforms
        (H, 3, 4) or (H, 4, 4) affine transforms D_k, mesh units.
    default
        (3, 4) or (4, 4) transform D₀, which takes what the weights leave of 1; the identity if left out.
    symmetry
        Plane across which handles act mirrored on the other side. Over its `band` the sides blend smoothly.
    handles
        (H,) vertex indices or (H, 3) positions: where handles stand, which tells their sides of the plane, the weights
        among them and the points about which other blends than linear take them apart. Where left out, a handle stands
        at the vertex with its largest weight.
    handle_weights
        (H, H) weights among handles for `overlap="interpolate"`, row j at the place of handle j; needed where handles
        stand at positions that are no vertices, otherwise the rows of `weights` at `handles`.
    normals
        (V, 3) unit normals to turn along, by the cofactors of each vertex's blended transform.
    overlap
        What becomes of weights whose sum passes 1. "paper": Eq. 1 to the letter, which scales the vertex by the sum
        about the origin. "add": displacements add, so that handles that rest change nothing. "normalize": weights are
        divided by their sum. "interpolate": displacements add, of weights times the inverse of those among the handles,
        so that each handle lands exactly where its own transform sends it (inside the band of a plane, in part).
    blend
        What of the transforms is blended. "linear": the matrices, Eq. 1.
        "dual_quaternion": each transform is a stretch about the handle's place and a rigid motion after it; stretches
        blend linearly, rigid motions as dual quaternions (Kavan et al., Geometric Skinning with Approximate Dual
        Quaternion Blending, 2008). This keeps the thickness of what is twisted. The rigid motion of a transform
        that flattens never mirrors. A mirrored transform keeps the mirror in its stretch, along the axis that leaves
        the smallest rotation. Where scale factors that mirror are equal, or two are 0, several motions qualify and any
        of them is taken.
    out
        (V, 3) array of the type of `vertices` for the result, otherwise a new one is made.

    Returns
    -------
    vertices
        (V, 3) in mesh units, float32 if `vertices` is (or has fewer digits), else float64; a torch tensor if it is one.
        With `normals`, a pair: the vertices, and (V, 3) unit normals of the same type. Where torch records gradients
        for `vertices`, `weights` or `transforms`, a linear blend gives them.

    Raises ValueError if shapes disagree, a value is not finite, a transform is not affine, two handles at one place
    cannot both arrive, gradients are asked for that there are none of, or `out` is not what the vertices fit in.

    Equation 1: V' = (max(1 − Σ W_k, 0) D₀ + Σ W_k D_k) V. With "add", V' = V + max(1 − Σ W_k, 0) (D₀ V − V) +
    Σ W_k (D_k V − V), which is the same where weights sum to at most 1, and leaves vertices as they are, to the bit,
    where all transforms are the identity. Dual quaternions take the same sums of what quaternions and stretches differ
    from the identity's by, each quaternion with the sign that turns it the shorter way from D₀; D₀ stands at the first
    vertex. They have no Eq. 1 to follow: their "paper" is "normalize".
    Equation 8: at vertices on the other side of the plane, with reflection R, handle k acts through R D_k R and stands
    at its mirror image. Within the band what is blended is mixed by a smoothstep.
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
    """Some handles move, the others rest: everything that rests is folded into one base, so a frame costs the movers.

    Parameters are those of `dfd.pose`, `transforms` being where the drag starts, and `moving` the handles that move:
    positions in 0 … H − 1 among the columns of `weights`. Only a linear blend can be folded: with the others a frame
    costs what `dfd.pose` does.
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
        """Fold the resting handles.

        Raises ValueError as `dfd.pose` does, or if `moving` is out of range or names a handle twice.
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
        # Handles that do nothing add nothing, so posing with the movers at rest leaves what they add to.
        resting = affine.copy()
        resting[self._moving] = IDENTITY
        self._base = empty_like(self._points)
        _run(rule, self._points, matrix, resting, self._base)
        self._weights = np.asfortranarray(_effective(rule, matrix, self._moving), np.float32)
        positive = None if rule.positive is None else np.ascontiguousarray(rule.positive[self._moving])
        self._rule = replace(rule, rest=IDENTITY, positive=positive, places=None, mixing=None, overlap="add")

    def pose(self, transforms: Any, *, out: Any = None) -> Any:
        """(V, 3) vertices with the moving handles at `transforms`, (M, 3, 4) or (M, 4, 4), in the order of `moving`.

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
    """How transforms become one, as the kernel takes it."""

    rest: Float64  # (3, 4) D₀
    plane: tuple[tuple[float, float, float], float, float] | None
    positive: Bool | None  # (H,) which handles stand where the plane's normal points
    places: Float64 | None  # (H, 3)
    mixing: Float64 | None  # (H, H) what the weights are multiplied by
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
    """(V, M) the weights of the `moving` handles by which displacements are added."""
    if rule.mixing is not None:
        return weights @ rule.mixing[:, moving].astype(np.float32)
    if rule.overlap == "normalize":
        return weights[:, moving] / np.maximum(weights.sum(axis=1, dtype=np.float64), 1.0)[:, None]
    return weights[:, moving]
