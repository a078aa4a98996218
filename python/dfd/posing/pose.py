"""Move vertices by blended transforms, with an optional mirror plane (Eq. 1 and 8)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypedDict, TypeVar, get_args, overload

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
    read_batch,
    read_points,
    read_weights,
    target,
)
from dfd.posing.overlap import interpolating
from dfd.posing.polar import Motions, turns_of

if TYPE_CHECKING:
    import torch
    from typing_extensions import Unpack

    from dfd.symmetry.plane import SymmetryPlane

Overlap = Literal["add", "interpolate", "normalize", "paper"]
# The index of each rule in the kernels. "interpolate" is "add" with weights that were multiplied by `_Rule.mixing`.
KERNEL_OVERLAPS = {"add": 0, "interpolate": 0, "paper": 1, "normalize": 2}
Blend = Literal["linear", "dual_quaternion"]  # in the order of the kernels

Out = TypeVar("Out")

IDENTITY = np.eye(3, 4)


class PoseOptions(TypedDict, total=False):
    """The arguments of `pose`, except `vertices`, `weights`, `transforms`, `normals` and `out`."""

    default: Any
    symmetry: SymmetryPlane | None
    handles: Any
    handle_weights: Any
    overlap: Overlap
    blend: Blend
    pivots: Any
    rotations: Any


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
    pivots: Any = None,
    rotations: Any = None,
    out: Any = None,
) -> Any:
    """Return the vertices, moved by the transforms of the handles that they follow.

    Raises ValueError if array shapes disagree, a value is not finite, a transform is not affine, or `out` has another
    array shape or type. Raises ValueError if two handles cannot move independently, or a tensor requires a gradient
    that is not implemented.

    A linear blend has gradients for `vertices`, `weights`, `transforms` and `default`, except with
    `overlap="interpolate"`. Kernels compute the first derivatives; torch computes those of higher order, which are
    slower. Where the sum of the weights is exactly 1, a derivative is that for smaller sums. The side of a handle, and
    without a band the side of a vertex, count as constant. `torch.func.vmap`, `vjp`, `jacrev` and `grad` work, with one
    call of a kernel for each item of the batch. Forward-mode differentiation (`jvp`, `jacfwd`) is not implemented.

    Equation 1: V' = (max(1 − Σ W_k, 0) D₀ + Σ W_k D_k) V. With "add":
    V' = V + max(1 − Σ W_k, 0) (D₀ V − V) + Σ W_k (D_k V − V). Both are equal if the sum of the weights is at most 1.
    With "add", vertices keep their exact bits if all transforms are the identity. With dual quaternions, the sums add
    quaternions and stretches, each minus the identity, and "paper" equals "normalize". Without `pivots`, the stretch of
    D₀ is about the first vertex.

    Equation 8: on the other side of the plane, the transform of handle k is R D_k R, where R is the reflection. In the
    band, a smoothstep blends both sides.

    Parameters
    ----------
    vertices
        (V, 3) in mesh units; float32 and float64 are read in place.
    weights
        (V, H), as `dfd.bind` returns them.
    transforms
        (H, 3, 4) or (H, 4, 4) affine transforms D_k, in mesh units. A batch of B poses is (B, H, 3, 4) or (B, H, 4, 4).
    default
        (3, 4) or (4, 4) default transform D₀, with weight max(1 − Σ W_k, 0); None is the identity.
    symmetry
        The mirror plane. A vertex follows the transforms of the handles on its own side of the plane, and the mirrored
        transforms of all other handles. In the plane's `band`, the results of both sides are blended smoothly.
    handles
        (H,) vertex indices or (H, 3) positions of the handles. They determine each handle's side of the plane, the
        handles' weights at each other's positions, and the centers of stretches (see `blend`). None means that each
        handle is at the vertex with its largest weight.
    handle_weights
        (H, H) matrix for `overlap="interpolate"`. Row j has the weights of all handles at the position of handle j.
        If this is None, `handles` must be vertices, and the rows of `weights` at these vertices are used.
    normals
        (V, 3) unit normals to transform too, by the cofactor matrix of each vertex's blended transform.
    overlap
        The rule for vertices whose weights have a sum above 1. "paper": Eq. 1 unchanged, which also multiplies their
        positions by this sum. "add": displacements are added, so identity transforms move nothing. "normalize": weights
        are divided by their sum. "interpolate": weights are multiplied by the inverse of `handle_weights`, and the
        displacements are added. Each handle moves exactly to its target, except in the band of a mirror plane.
    blend
        The quantity that is blended. "linear": the matrices, Eq. 1. "dual_quaternion": each transform is divided into a
        stretch about the handle's position and a rigid motion. Stretches are blended linearly, and rigid motions as
        dual quaternions of half the rotation, applied twice (Kavan et al., Geometric Skinning with Approximate Dual
        Quaternion Blending, 2008). This keeps the thickness of twisted parts. If a transform mirrors, its stretch
        contains the reflection that leaves the smallest rotation. The rotation never mirrors, even if the transform is
        singular.
    pivots
        (H + 1, 3) centers of the stretches and rotations of all handles and, last, of D₀, in mesh units, for dual
        quaternions. The displacements of the centers are blended linearly. By default, a rigid motion is a screw.
    rotations
        (H + 1, 3) rotation vectors in degrees of the rotations in `transforms` and D₀, which need `pivots`. They say
        which way a rotation goes, and how often: the result is a continuous function of rotations up to 720°. By
        default, all rotations go the shorter way from D₀.
    out
        (V, 3) array for the result, or (B, V, 3) for a batch, with the type of `vertices`; None makes a new array.

    Returns
    -------
    vertices
        (V, 3) in mesh units, or (B, V, 3) for a batch: float32 if `vertices` is float32, float16 or bfloat16, else
        float64. A torch tensor if `vertices` is one. With `normals`, a pair: the vertices, and unit normals of the same
        array shape and type. If a tensor requires a gradient, the result is a tensor with gradients.

    Examples
    --------
    A vertex with the weight 0.5 moves half as far as the handle:

    >>> import dfd
    >>> raise_by_2 = [[1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 1, 0]]
    >>> dfd.pose([[0.0, 0, 0], [1, 0, 0]], [[1.0], [0.5]], [raise_by_2])
    array([[0., 2., 0.],
           [1., 1., 0.]])
    """
    options: dict[str, Any] = {"symmetry": symmetry, "handles": handles, "overlap": overlap, "blend": blend}
    options |= {"handle_weights": handle_weights, "default": default, "normals": normals, "out": out}
    options |= {"pivots": pivots, "rotations": rotations}
    if tensors.tracked(vertices, weights, transforms, default, normals, handle_weights, out):
        from dfd.posing.gradients import posed_with_gradients

        return posed_with_gradients(_posed, _prepared, vertices, weights, transforms, options)
    result, turned = _posed(vertices, weights, transforms, **options)
    result = tensors.like(vertices, result) if out is None else out
    return result if turned is None else (result, tensors.like(vertices, turned))


def _posed(
    vertices: Any, weights: Any, transforms: Any, default: Any, *, normals: Any = None, out: Any = None, **options: Any
) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Return the posed vertices, and the normals if `normals` are given. The arguments are those of `pose`."""
    points, matrix, affine, polar, rule = _prepared(vertices, weights, transforms, default, **options)
    batch = len(affine) if np.ndim(transforms) == 4 else None
    directions = turned = None
    if normals is not None:
        directions = check.array("pose", "normals", normals, points.shape, dtype=points.dtype, finite=False)
        turned = empty_like(points, batch)
    posed = target("pose", out, points, {"vertices": points, "weights": matrix, "normals": directions}, batch)
    for k, each in enumerate(affine):
        into = posed if batch is None else posed[k]
        turned_into = turned if batch is None or turned is None else turned[k]
        motion = each, None if polar is None else polar[k], *rule
        _core.pose(points, matrix, *motion, None, directions, into, turned_into, threads.get_num_threads())
    return posed, turned


class _Prepared(NamedTuple):
    """The arguments of `pose`, converted for the kernel."""

    points: NDArray[Any]  # (V, 3)
    weights: Float32  # (V, H)
    affine: Float64  # (B, H, 3, 4) the transforms of each pose of a batch
    polar: Float64 | None  # (B, N, 19) the rows of `dfd::Motion::polar` of each pose; None if the blend is linear
    rule: _Rule


def _prepared(
    vertices: Any,
    weights: Any,
    transforms: Any,
    default: Any,
    *,
    symmetry: SymmetryPlane | None,
    handles: Any,
    overlap: Overlap,
    handle_weights: Any = None,
    blend: Blend = "linear",
    pivots: Any = None,
    rotations: Any = None,
) -> _Prepared:
    """Check the arguments of `pose`, and convert them for the kernel."""
    points = read_points("pose", vertices)
    matrix = read_weights("pose", weights, len(points))
    affine = read_batch("pose", "transforms", transforms, matrix.shape[1])
    rule, places = _rule("pose", points, matrix, default, symmetry, handles, handle_weights, overlap, blend)
    return _Prepared(points, matrix, affine, _polar("pose", affine, rule, places, pivots, rotations), rule)


class Drag:
    """A series of poses in which only some handles move. The displacements by all other handles are added once.

    The parameters are those of `dfd.pose`, and `moving`: the indices of the handles that move. `transforms` are those
    at the start of the drag. With dual quaternions, no sum is computed: each pose takes as long as `dfd.pose`.
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
        pivots: Any = None,
        rotations: Any = None,
    ) -> None:
        """Compute the sum of the displacements by the handles that do not move.

        Raises ValueError as `dfd.pose` does, or if `moving` is out of range or contains a handle twice.
        """
        if tensors.tracked(vertices, weights, transforms, default, handle_weights):
            raise ValueError("Drag: a drag has no gradients: detach the tensors that require gradients")
        self._points = read_points("Drag", vertices).copy()
        matrix = read_weights("Drag", weights, len(self._points))
        affine = read_affine("Drag", "transforms", transforms, matrix.shape[1])
        self._moving = check.vertex_indices("Drag", "moving", np.atleast_1d(moving), matrix.shape[1], unique=True)
        rule, self._places = _rule(
            "Drag", self._points, matrix, default, symmetry, handles, handle_weights, overlap, blend
        )
        self._like = vertices if tensors.is_tensor(vertices) else None
        self._base: NDArray[Any] | None = None
        if blend != "linear":
            self._rule, self._weights, self._transforms = rule, matrix.copy(order="K"), affine.copy()
            _polar("Drag", affine[np.newaxis], rule, self._places, pivots, rotations)
            return
        # If the moving handles have the identity, they add no displacement, so the pose is the sum over all others.
        resting = affine.copy()
        resting[self._moving] = IDENTITY
        self._base = empty_like(self._points)
        _core.pose(self._points, matrix, resting, None, *rule, None, None, self._base, None, threads.get_num_threads())
        self._weights = np.asfortranarray(_effective(rule, matrix, self._moving), np.float32)
        positive = None if rule.positive is None else np.ascontiguousarray(rule.positive[self._moving])
        self._rule, self._places = rule._replace(rest=IDENTITY, positive=positive, mixing=None, overlap=0), None

    @property
    def weights(self) -> Float32:
        """Return the weights that `pose` uses, which can be changed between two poses if D₀ is the identity.

        They are those of the moving handles, (V, M), or with dual quaternions those of all handles, (V, H).
        """
        return self._weights

    def pose(self, transforms: Any, *, pivots: Any = None, rotations: Any = None, out: Any = None) -> Any:
        """Return the vertices (V, 3) for `transforms` (M, 3, 4) or (M, 4, 4) of the handles, in the order of `moving`.

        `pivots` and `rotations` (H + 1, 3) are those of all handles and D₀, as in `dfd.pose`. The result is in the
        array `out` (V, 3), if it is given.

        Raises ValueError as `dfd.pose` does.
        """
        if tensors.tracked(transforms, out):
            raise ValueError("Drag.pose: a drag has no gradients: detach the tensors that require gradients")
        affine = read_affine("Drag.pose", "transforms", transforms, len(self._moving))
        posed = target("Drag.pose", out, self._points, {"vertices": self._points, "base": self._base})
        if self._base is None:
            self._transforms[self._moving] = affine
            affine = self._transforms
        polar = _polar("Drag.pose", affine[np.newaxis], self._rule, self._places, pivots, rotations)
        inputs = self._points, self._weights, affine, None if polar is None else polar[0], *self._rule, self._base
        _core.pose(*inputs, None, posed, None, threads.get_num_threads())
        return tensors.like(self._like, posed) if out is None else out


class _Rule(NamedTuple):
    """The rule by which transforms are blended: arguments of the kernel, in the order of its parameters."""

    rest: Float64  # (3, 4) D₀
    plane: tuple[tuple[float, float, float], float, float] | None  # normal, offset and band of the mirror plane
    positive: Bool | None  # (H,) whether a handle is on the side to which the plane's normal points, or in the plane
    mixing: Float64 | None  # (H, H) matrix by which the weights are multiplied
    overlap: int  # index in `KERNEL_OVERLAPS`
    blend: int  # index in `Blend`


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
) -> tuple[_Rule, Float64 | None]:
    """Check the options of `pose`, and convert them for the kernel.

    Also return the centers (H + 1, 3) of stretches for dual quaternions; None for a linear blend.
    """
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
        among = handle_weight_matrix(function, handle_weights, weights, indices)
        mixing = np.ascontiguousarray(interpolating(function, among))
    first = np.asarray(points[:1] if len(points) else np.zeros((1, 3)), np.float64)
    plane = None if symmetry is None else (symmetry.normal, symmetry.offset, symmetry.band)
    numbers = KERNEL_OVERLAPS[overlap], get_args(Blend).index(blend)
    rule = _Rule(rest, plane, positive, mixing, *numbers)
    return rule, None if blend == "linear" or places is None else np.concatenate([places, first])


def _polar(
    function: str, transforms: Float64, rule: _Rule, places: Float64 | None, pivots: Any, rotations: Any
) -> Float64 | None:
    """Return the rows (B, N, 19) of `dfd::Motion::polar` for `transforms` (B, H, 3, 4); None if the blend is linear.

    `places` (H + 1, 3) are the centers of stretches without `pivots`.
    """
    batch, count = len(transforms), transforms.shape[1] + 1
    given = [
        None if value is None else check.array(function, name, value, (count, 3), dtype=np.float64)
        for name, value in (("pivots", pivots), ("rotations", rotations))
    ]
    if given[0] is None and given[1] is not None:
        raise ArgumentError("pivots", "must be given with `rotations`", function)
    if places is None:
        return None
    rest = np.broadcast_to(rule.rest, (batch, 1, 3, 4))
    maps = np.concatenate([transforms, rest], axis=1).reshape(-1, 3, 4)
    turns = turns_of(maps[..., :3]) if given[1] is None else np.tile(np.radians(given[1]), (batch, 1))
    centers = np.tile(places if given[0] is None else given[0], (batch, 1))
    motions = Motions(maps[..., :3] - np.eye(3), maps[..., 3], centers, turns, given[0] is not None)
    sides = [motions]
    if rule.plane is not None:
        normal, offset = np.asarray(rule.plane[0]), rule.plane[1]
        linear = np.eye(3) - 2 * np.outer(normal, normal)
        sides.append(motions.mirrored(np.column_stack([linear, 2 * offset * normal])))
    if given[1] is None:
        sides = [each.towards(turns[-1]) for each in sides]
    rows = [each.rows().reshape(batch, count, 19) for each in sides]
    handles = [each[:, :-1] for each in rows]
    return np.concatenate([*handles, rows[0][:, -1:]], axis=1)


def _effective(rule: _Rule, weights: Float32, moving: Int64) -> NDArray[Any]:
    """Return the weights (V, M) of the `moving` handles after mixing or normalization."""
    if rule.mixing is not None:
        return weights @ rule.mixing[:, moving].astype(np.float32)
    if rule.overlap == KERNEL_OVERLAPS["normalize"]:
        return weights[:, moving] / np.maximum(weights.sum(axis=1, dtype=np.float64), 1.0)[:, None]
    return weights[:, moving]
