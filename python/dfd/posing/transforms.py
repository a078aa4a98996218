"""Translation, rotation and scale about a pivot, as the (3, 4) affine matrices that `dfd.pose` blends.

A rotation is a *rotation vector in degrees*: its direction is the axis, its length the angle, right-handed. (0, 90, 0)
turns by 90° about y. It has neither an order of axes to agree on nor a gimbal lock, half the vector is half the turn,
and about a single axis it reads like an Euler angle. A quaternion (x, y, z, w), in glTF's order, is taken wherever a
rotation is and becomes a rotation vector.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check

__all__ = ["affine", "rotation_matrix", "rotation_vector", "scale_factors", "vector"]

Vector = tuple[float, float, float]

# Beyond it a float64 has no digits left for the part that matters, what exceeds the whole turns.
LARGEST_ANGLE = 1e9


def affine(
    *,
    translation: ArrayLike = (0.0, 0.0, 0.0),
    rotation: ArrayLike = (0.0, 0.0, 0.0),
    scale: ArrayLike = 1.0,
    pivot: ArrayLike = (0.0, 0.0, 0.0),
) -> NDArray[np.float64]:
    """The map p ↦ pivot + translation + R S (p − pivot), as a (3, 4) matrix in mesh units.

    Parameters
    ----------
    translation
        (3,) in mesh units.
    rotation
        (3,) rotation vector in degrees, or (4,) quaternion (x, y, z, w) of any length but 0.
    scale
        One factor or (3,), along the mesh's axes before the rotation. 0 flattens, a negative factor mirrors.
    pivot
        (3,) in mesh units, the point that rotation and scale leave in place.

    Raises
    ------
    ValueError
        If an argument has another shape or is not finite, or the numbers are so large that the matrix is not finite.
    """
    center = np.asarray(vector("affine", "pivot", pivot))
    matrix = np.empty((3, 4))
    with np.errstate(over="ignore", invalid="ignore"):
        matrix[:, :3] = rotation_matrix(rotation) * np.asarray(scale_factors("affine", scale))
        matrix[:, 3] = center + np.asarray(vector("affine", "translation", translation)) - matrix[:, :3] @ center
    if not np.isfinite(matrix).all():
        raise ValueError("affine: `translation`, `scale` and `pivot` are too large: the matrix is not finite")
    return matrix


def rotation_matrix(rotation: ArrayLike) -> NDArray[np.float64]:
    """R, (3, 3), of a rotation vector in degrees or a quaternion (x, y, z, w).

    Raises
    ------
    ValueError
        If `rotation` has neither 3 nor 4 finite numbers, or is the quaternion 0.
    """
    turn = np.asarray(rotation_vector("rotation_matrix", rotation))
    degrees = float(np.linalg.norm(turn))
    if degrees == 0.0:
        return np.eye(3)
    x, y, z = turn / degrees
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # Whole turns taken off in degrees, where they are exact.
    angle = math.radians(math.fmod(degrees, 360.0))
    matrix: NDArray[np.float64] = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    return matrix  # Rodrigues' formula


def rotation_vector(function: str, rotation: ArrayLike) -> Vector:
    """`rotation` as a rotation vector in degrees; a quaternion takes the shorter way round."""
    numbers = _numbers(function, "rotation", rotation)
    if numbers.shape == (3,):
        if np.abs(numbers).max() > LARGEST_ANGLE:
            raise ValueError(
                f"{function}: `rotation` must stay within ±{LARGEST_ANGLE:g} degrees, got {_triple(numbers)}"
            )
        return _triple(numbers)
    if numbers.shape != (4,):
        raise ValueError(
            f"{function}: `rotation` must be a rotation vector in degrees (3 numbers) "
            f"or a quaternion x y z w (4 numbers), got shape {numbers.shape}"
        )
    largest = np.abs(numbers).max()
    if largest == 0.0:
        raise ValueError(f"{function}: `rotation` must be a quaternion other than 0")
    quaternion = numbers / largest  # neither squares of large numbers nor of small ones
    quaternion *= -1.0 if quaternion[3] < 0 else 1.0
    sine = float(np.linalg.norm(quaternion[:3]))
    if sine == 0.0:
        return (0.0, 0.0, 0.0)
    return _triple(quaternion[:3] / sine * math.degrees(2.0 * math.atan2(sine, float(quaternion[3]))))


def scale_factors(function: str, scale: ArrayLike) -> Vector:
    """`scale`, one factor or three, as three factors."""
    numbers = _numbers(function, "scale", scale)
    if numbers.shape not in ((), (3,)):
        raise ValueError(f"{function}: `scale` must be one number or 3, got shape {numbers.shape}")
    return _triple(np.broadcast_to(numbers, (3,)))


def vector(function: str, name: str, value: ArrayLike) -> Vector:
    """`value` as three finite numbers."""
    numbers = _numbers(function, name, value)
    if numbers.shape != (3,):
        raise ValueError(f"{function}: `{name}` must be 3 numbers, got shape {numbers.shape}")
    return _triple(numbers)


def _numbers(function: str, name: str, value: Any) -> NDArray[np.float64]:
    if value is None or np.isscalar(value) or getattr(value, "ndim", 1) == 0:
        return check.array(function, name, value, (), dtype=np.float64).reshape(())
    return check.array(function, name, value, (None,), dtype=np.float64)


def _triple(numbers: NDArray[np.float64]) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return (x, y, z)
