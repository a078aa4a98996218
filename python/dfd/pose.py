"""Vertices moved by blended transforms, across a mirror plane when there is one (Eq. 1 and 8)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd import _core, check, tensors, threads

if TYPE_CHECKING:
    from dfd.symmetry import SymmetryPlane

__all__ = ["pose"]


def pose(
    vertices: Any,
    weights: Any,
    transforms: Any,
    *,
    default: Any = None,
    symmetry: SymmetryPlane | None = None,
    handles: Any = None,
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
    out
        (V, 3) array of the type of `vertices` for the result, otherwise a new one is made.

    Returns
    -------
    vertices
        (V, 3) in mesh units, float32 if `vertices` is (or has fewer digits), else float64; a torch tensor if it is one.

    Raises
    ------
    ValueError
        If shapes disagree, a value is not finite, a transform is not affine, or `out` is not what the vertices fit in.

    Equation 1: V' = (max(1 − Σ W_k, 0) D₀ + Σ W_k D_k) V. Where weights sum to more than 1 nothing is normalised.
    Equation 8: at vertices on the other side of the plane, with reflection R, handle k acts through R D_k R.
    """
    points = tensors.shared("pose", "vertices", vertices)
    dtype = np.float32 if getattr(points, "dtype", None) in (np.float32, np.float16) else np.float64
    points = tensors.contiguous("pose", "vertices", points, ("V", 3), dtype)
    matrix = tensors.contiguous("pose", "weights", weights, (len(points), "H"), np.float32)
    affine = _affine("transforms", transforms, matrix.shape[1])
    rest = np.eye(4)[:3] if default is None else _affine("default", default, None)[0]

    plane = positive = None
    if symmetry is not None:
        plane = (tuple(symmetry.normal), symmetry.offset, symmetry.band)
        positive = _positive_sides(symmetry, handles, points, matrix)

    target = None
    if out is not None:
        target = tensors.output("pose", out, points.shape, dtype, {"vertices": points, "weights": matrix})
    posed = _core.pose(points, matrix, affine, rest, plane, positive, target, threads.get_num_threads())
    return tensors.like(vertices, posed) if out is None else out


def _affine(name: str, value: Any, count: int | None) -> NDArray[np.float64]:
    """(H, 3, 4) transforms, or (1, 3, 4) when `count` is None and `value` is a single one."""
    array = np.asarray(tensors.shared("pose", name, value))
    if count is None:
        array = array[np.newaxis] if array.ndim == 2 else array
    elif array.size == 0 and count == 0:
        return np.zeros((0, 3, 4))
    if array.ndim != 3 or array.shape[1:] not in ((3, 4), (4, 4)) or len(array) != (1 if count is None else count):
        leading = "" if count is None else f"{count}, "
        shape = np.shape(value) if count is None else array.shape
        raise ValueError(f"pose: `{name}` must have shape ({leading}3, 4) or ({leading}4, 4), got {shape}")
    result = check.array("pose", name, array, (None, None, 4), dtype=np.float64)
    if result.shape[1] == 4 and np.abs(result[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(initial=0.0) > 1e-6:
        wrong = np.abs(result[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1).argmax()
        raise ValueError(f"pose: `{name}` must have the bottom row [0, 0, 0, 1], got {result[wrong, 3].tolist()}")
    return np.ascontiguousarray(result[:, :3])


def _positive_sides(
    symmetry: SymmetryPlane, handles: Any, vertices: NDArray[Any], weights: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """(H,) whether each handle stands on the side that the plane's normal points to."""
    count = weights.shape[1]
    if handles is None:
        places = vertices[weights.argmax(axis=0)] if len(vertices) else np.zeros((count, 3))
    else:
        array = np.asarray(tensors.shared("pose", "handles", handles))
        if array.ndim == 2:
            places = check.array("pose", "handles", array, (count, 3), dtype=np.float64)
        else:
            indices = check.vertex_indices("pose", "handles", array, len(vertices))
            if len(indices) != count:
                raise ValueError(
                    f"pose: `handles` must name {count} handles, as many as `weights` has, got {len(indices)}"
                )
            places = vertices[indices]
    heights = places.astype(np.float64) @ np.asarray(symmetry.normal, np.float64) - symmetry.offset
    return np.ascontiguousarray(heights >= 0)
