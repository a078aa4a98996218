"""Vertices moved by blended transforms, across a mirror plane when there is one (Eq. 1 and 8)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd import _core
from dfd.common import check, tensors, threads

if TYPE_CHECKING:
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["Drag", "pose"]

IDENTITY = np.eye(3, 4)
IDENTITY.flags.writeable = False


def pose(
    vertices: Any,
    weights: Any,
    transforms: Any,
    *,
    default: Any = None,
    symmetry: SymmetryPlane | None = None,
    handles: Any = None,
    normals: Any = None,
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
        With `symmetry`: (H,) vertex indices or (H, 3) positions, which tell each handle's side; where left out, a
        handle stands at the vertex with its largest weight.
    normals
        (V, 3) unit normals to turn along, by the cofactors of each vertex's blended transform.
    out
        (V, 3) array of the type of `vertices` for the result, otherwise a new one is made.

    Returns
    -------
    vertices
        (V, 3) in mesh units, float32 if `vertices` is (or has fewer digits), else float64; a torch tensor if it is one.
        With `normals`, a pair: the vertices, and (V, 3) unit normals of the same type.

    Raises
    ------
    ValueError
        If shapes disagree, a value is not finite, a transform is not affine, or `out` is not what the vertices fit in.

    Equation 1: V' = (max(1 − Σ W_k, 0) D₀ + Σ W_k D_k) V. Where weights sum to more than 1 nothing is normalised.
    Equation 8: at vertices on the other side of the plane, with reflection R, handle k acts through R D_k R.
    """
    points = _points("pose", vertices)
    matrix = _weights("pose", weights, len(points))
    affine = _affine("pose", "transforms", transforms, matrix.shape[1])
    rest = IDENTITY if default is None else _affine("pose", "default", default, None)[0]
    plane = _plane(symmetry)
    positive = None if symmetry is None else _positive_sides("pose", symmetry, handles, points, matrix)
    directions = turned = None
    if normals is not None:
        directions = tensors.contiguous("pose", "normals", normals, points.shape, points.dtype)
        turned = _empty_like(points)
    posed = _target("pose", out, points, {"vertices": points, "weights": matrix, "normals": directions})
    count = threads.get_num_threads()
    _core.pose(points, matrix, affine, rest, plane, positive, None, directions, posed, turned, count)
    result = tensors.like(vertices, posed) if out is None else out
    return result if turned is None else (result, tensors.like(vertices, turned))


class Drag:
    """Some handles move, the others rest: everything that rests is folded into one base, so a frame costs the movers.

    Parameters are those of `dfd.pose`, `transforms` being where the drag starts, and `moving` the handles that move:
    positions in 0 … H − 1 among the columns of `weights`.
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
    ) -> None:
        """Fold the resting handles.

        Raises
        ------
        ValueError
            As `dfd.pose` does, or if `moving` is out of range or names a handle twice.
        """
        self._points = _points("Drag", vertices).copy()
        matrix = _weights("Drag", weights, len(self._points))
        affine = _affine("Drag", "transforms", transforms, matrix.shape[1])
        rest = IDENTITY if default is None else _affine("Drag", "default", default, None)[0]
        self._moving = check.vertex_indices("Drag", "moving", np.atleast_1d(moving), matrix.shape[1], unique=True)
        self._plane = _plane(symmetry)
        positive = None if symmetry is None else _positive_sides("Drag", symmetry, handles, self._points, matrix)
        self._positive = None if positive is None else np.ascontiguousarray(positive[self._moving])
        self._weights = np.asfortranarray(matrix[:, self._moving])
        # Handles that do nothing add nothing, so posing with the movers at rest leaves what they add to.
        resting = affine.copy()
        resting[self._moving] = IDENTITY
        self._base = _empty_like(self._points)
        count = threads.get_num_threads()
        _core.pose(self._points, matrix, resting, rest, self._plane, positive, None, None, self._base, None, count)
        self._like = vertices if tensors.is_tensor(vertices) else None

    def pose(self, transforms: Any, *, out: Any = None) -> Any:
        """(V, 3) vertices with the moving handles at `transforms`, (M, 3, 4) or (M, 4, 4), in the order of `moving`.

        Raises
        ------
        ValueError
            As `dfd.pose` does.
        """
        affine = _affine("Drag.pose", "transforms", transforms, len(self._moving))
        posed = _target("Drag.pose", out, self._points, {"vertices": self._points, "base": self._base})
        _core.pose(
            self._points,
            self._weights,
            affine,
            IDENTITY,
            self._plane,
            self._positive,
            self._base,
            None,
            posed,
            None,
            threads.get_num_threads(),
        )
        return tensors.like(self._like, posed) if out is None else out


def _points(function: str, vertices: Any) -> NDArray[Any]:
    points = tensors.shared(function, "vertices", vertices)
    dtype = np.float32 if getattr(points, "dtype", None) in (np.float32, np.float16) else np.float64
    return tensors.contiguous(function, "vertices", points, ("V", 3), dtype)


def _weights(function: str, weights: Any, vertex_count: int) -> NDArray[np.float32]:
    """(V, H) in place if rows or columns are contiguous."""
    matrix = tensors.shared(function, "weights", weights)
    if (
        isinstance(matrix, np.ndarray)
        and matrix.dtype == np.float32
        and matrix.ndim == 2
        and len(matrix) == vertex_count
        and tensors.lines_contiguous(matrix)
    ):
        return matrix
    return tensors.contiguous(function, "weights", matrix, (vertex_count, "H"), np.float32)


def _empty_like(points: NDArray[Any]) -> NDArray[Any]:
    return (_core.empty_float32 if points.dtype == np.float32 else _core.empty_float64)(*points.shape)


def _target(function: str, out: Any, points: NDArray[Any], inputs: dict[str, NDArray[Any] | None]) -> NDArray[Any]:
    """Where the vertices go."""
    if out is None:
        return _empty_like(points)
    return tensors.output(function, out, points.shape, points.dtype, inputs)


def _affine(function: str, name: str, value: Any, count: int | None) -> NDArray[np.float64]:
    """(H, 3, 4) transforms, or (1, 3, 4) when `count` is None and `value` is a single one."""
    array = np.asarray(tensors.shared(function, name, value))
    if array.shape == (count, 3, 4) and array.dtype == np.float64 and array.flags.c_contiguous:
        return array  # whose finiteness the kernel checks
    if count is None:
        array = array[np.newaxis] if array.ndim == 2 else array
    elif array.size == 0 and count == 0:
        return np.zeros((0, 3, 4))
    if array.ndim != 3 or array.shape[1:] not in ((3, 4), (4, 4)) or len(array) != (1 if count is None else count):
        leading = "" if count is None else f"{count}, "
        shape = np.shape(value) if count is None else array.shape
        raise ValueError(f"{function}: `{name}` must have shape ({leading}3, 4) or ({leading}4, 4), got {shape}")
    result = check.array(function, name, array, (None, None, 4), dtype=np.float64)
    if result.shape[1] == 4 and np.abs(result[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(initial=0.0) > 1e-6:
        wrong = np.abs(result[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1).argmax()
        raise ValueError(f"{function}: `{name}` must have the bottom row [0, 0, 0, 1], got {result[wrong, 3].tolist()}")
    return np.ascontiguousarray(result[:, :3])


def _plane(symmetry: SymmetryPlane | None) -> tuple[tuple[float, float, float], float, float] | None:
    if symmetry is None:
        return None
    return symmetry.normal, symmetry.offset, symmetry.band


def _positive_sides(
    function: str, symmetry: SymmetryPlane, handles: Any, vertices: NDArray[Any], weights: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """(H,) whether each handle stands on the side that the plane's normal points to."""
    count = weights.shape[1]
    if handles is None:
        places = vertices[weights.argmax(axis=0)] if len(vertices) else np.zeros((count, 3))
    else:
        array = np.asarray(tensors.shared(function, "handles", handles))
        if array.ndim == 2:
            places = check.array(function, "handles", array, (count, 3), dtype=np.float64)
        else:
            indices = check.vertex_indices(function, "handles", array, len(vertices))
            if len(indices) != count:
                raise ValueError(
                    f"{function}: `handles` must name {count} handles, as many as `weights` has, got {len(indices)}"
                )
            places = vertices[indices]
    heights = places.astype(np.float64) @ np.asarray(symmetry.normal, np.float64) - symmetry.offset
    return np.ascontiguousarray(heights >= 0)
