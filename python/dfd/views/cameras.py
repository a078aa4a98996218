"""Place cameras around a shape, in evenly spread directions, so that the shape fills each picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64

Framing = Literal["shape", "paper"]

FIELD_OF_VIEW = 60.0  # in degrees, as in the paper's public code; the paper gives no value
# The distance of cameras from the center of a shape in the cube [−1, 1]³ is that of the paper's public code. The paper
# gives no value.
PAPER_DISTANCE = 2.8
MARGIN = 1.06  # the picture is at least this many times as wide as the shape in it
CLEARANCE = 0.2  # smallest distance of the shape from the eye, divided by half of the bounding box's longest side
_MIRROR_IMAGES = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]])  # signs of x, y, z
_CHUNK = 1 << 12  # number of points per matrix product, which then fits the processor's cache


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with a square picture, in the coordinates of a shape that is scaled into the cube [−1, 1]³.

    The axes right, up and back are orthonormal, and the camera looks along −back. The right axis of a mirrored camera
    is negated, so that the picture is a mirror image.
    """

    position: Float64  # (3,) position of the eye
    right: Float64  # (3,)
    up: Float64  # (3,)
    back: Float64  # (3,)
    field_of_view: float = FIELD_OF_VIEW  # full angle across the picture, in degrees

    @property
    def half_width(self) -> float:
        """Return half the width of the area that the picture shows at distance 1 from the eye."""
        return float(np.tan(np.radians(self.field_of_view) / 2))

    def ray_directions(self, resolution: int) -> Float32:
        """Return the unit directions (R², 3) of rays through the centers of pixels, row by row from the top left."""
        across = ((np.arange(resolution) + 0.5) / resolution * 2 - 1) * self.half_width
        x, y = np.tile(across, resolution), np.repeat(-across, resolution)
        # NumPy is slow if the last axis has length 3, so the three coordinates are the first axis here.
        local = np.stack([x, y, np.full(len(x), -1.0)]) / np.sqrt(1 + x * x + y * y)
        return np.ascontiguousarray((np.array([self.right, self.up, self.back]).T @ local).T, np.float32)

    def in_mesh(self, frame: Float64) -> Camera:
        """Return the camera in mesh coordinates. There, the rows of `frame` (3, 3) are the present x, y and z axes."""
        axes = (self.position @ frame, self.right @ frame, self.up @ frame, self.back @ frame)
        return Camera(*axes, self.field_of_view)

    def project(self, points: NDArray[np.floating[Any]], resolution: int) -> tuple[Float64, Float64]:
        """Return the rows (N,) and columns (N,) of `points` (N, 3) in the picture; whole numbers are pixel centers."""
        offset = points - self.position
        depth = -(offset @ self.back) * self.half_width
        column = (offset @ self.right / depth + 1) / 2 * resolution - 0.5
        row = (1 - offset @ self.up / depth) / 2 * resolution - 0.5
        return row, column


def fibonacci_directions(count: int, *, mirrored: bool = False) -> Float64:
    """Return unit directions (count, 3), evenly spread over the sphere.

    If `mirrored` is True, the directions form groups of four that are mirror images in the planes x = 0 and z = 0. If
    `count` is not a multiple of four, the remaining directions lie in these planes.

    Raises ValueError if `count` is less than 1.
    """
    count = check.whole("fibonacci_directions", "count", count, minimum=1)
    if not mirrored:
        index = np.arange(count) + 0.5
        return _sphere(1 - 2 * index / count, np.pi * (1 + np.sqrt(5)) * index)
    # Near the planes, directions of a Fibonacci spiral would be close to their mirror images. So a quarter of the
    # directions lies on a few meridians in one quarter of the sphere, and is mirrored into the other three quarters.
    index = np.arange(count // 4) + 0.5
    meridians = max(2, round(np.sqrt(len(index) / 2.5)))
    quarter = _sphere(1 - 2 * index / max(len(index), 1), np.pi / 2 * (index % meridians) / meridians)
    sides = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])[: count % 4 // 2 * 2]
    front = np.array([[0.0, 0.0, 1.0]])[: count % 2]
    return np.concatenate([*(quarter * signs for signs in _MIRROR_IMAGES), sides, front])


def camera_towards(
    direction: ArrayLike, points: NDArray[np.floating[Any]], *, field_of_view: float = FIELD_OF_VIEW
) -> Camera:
    """Return a camera that looks along −`direction` (3,), and whose picture contains all `points` (N, 3).

    Raises ValueError if `direction` is 0.
    """
    unit = check.array("camera_towards", "direction", direction, (3,), dtype=np.float64)
    length = np.linalg.norm(unit)
    if length == 0:
        raise ValueError("camera_towards: `direction` must not be 0, got 0, 0, 0")
    return _place(unit[None] / length, points, "shape", field_of_view, np.zeros(1, bool))[0]


def place_cameras(
    count: int, points: NDArray[np.floating[Any]], *, framing: Framing = "shape", mirrored: bool = False
) -> list[Camera]:
    """Return `count` cameras around a shape in the cube [−1, 1]³ with the vertices `points` (N, 3).

    With `framing` "shape", each camera is as near as possible, but its picture contains the whole shape and a small
    margin. The eye's distance from the shape is at least a tenth of the shape's largest extent. With "paper", cameras
    look at the origin from a distance of 2.8.

    If `mirrored` is True, cameras form groups of four that are mirror images in the planes x = 0 and z = 0. Pictures
    of a shape that is symmetric in one of these planes then show both sides equally.

    Raises ValueError if `count` is less than 1 or `framing` is unknown.
    """
    directions = fibonacci_directions(count, mirrored=mirrored)
    x, z = directions[:, 0], directions[:, 2]
    flipped = mirrored & ((x * z < 0) | ((z == 0) & (x < 0)))  # the direction is mirrored in exactly one of the planes
    return _place(directions, points, framing, FIELD_OF_VIEW, flipped)


def _place(
    directions: Float64, points: NDArray[np.floating[Any]], framing: Framing, field_of_view: float, flipped: Bool
) -> list[Camera]:
    """Return a camera in each of `directions` (K, 3); its picture is mirrored if `flipped` (K,) is True."""
    check.choice("place_cameras", "framing", framing, Framing)
    field_of_view = check.number("place_cameras", "field_of_view", field_of_view, minimum=1.0, maximum=170.0)
    bases = [_basis(direction, turn) for direction, turn in zip(directions, flipped, strict=True)]
    if framing == "paper":
        return [Camera(PAPER_DISTANCE * basis[2], *basis, field_of_view) for basis in bases]
    slope = np.tan(np.radians(field_of_view) / 2) / MARGIN
    # In coordinates x, y, z along right, up and back, a camera at (c_x, c_y, d) sees a point q if
    # |q_x − c_x| ≤ slope (d − q_z), and likewise for y. These bounds are linear in q, so one matrix product gives their
    # extremes for all cameras. The fifth row of each camera gives the largest q_z, at the point nearest to the eye.
    bounds = [
        [right + slope * back, slope * back - right, up + slope * back, slope * back - up, back]
        for right, up, back in bases
    ]
    largest = _largest_along(np.concatenate([*bounds, np.eye(3), -np.eye(3)]), points)
    clearance = CLEARANCE * float((largest[-6:-3] + largest[-3:]).max()) / 2
    largest = largest[:-6].reshape(-1, 5)
    cameras = []
    for (right, up, back), (to_right, to_left, to_top, to_bottom, nearest) in zip(bases, largest, strict=True):
        distance = max((to_right + to_left) / (2 * slope), (to_top + to_bottom) / (2 * slope), nearest + clearance)
        position = (to_right - to_left) / 2 * right + (to_top - to_bottom) / 2 * up + distance * back
        cameras.append(Camera(position, right, up, back, field_of_view))
    return cameras


def _largest_along(normals: Float64, points: NDArray[np.floating[Any]]) -> Float64:
    """Return the largest scalar product (K,) of each of `normals` (K, 3) with any of `points` (N, 3)."""
    rows = normals.astype(np.float32)
    largest = np.full(len(normals), -np.inf, np.float32)
    for start in range(0, len(points), _CHUNK):
        chunk = np.asarray(points[start : start + _CHUNK], np.float32)
        np.maximum(largest, (rows @ chunk.T).max(axis=1), out=largest)
    return largest.astype(np.float64)


def _basis(direction: Float64, flipped: bool) -> tuple[Float64, Float64, Float64]:
    """Return right, up and back of an upright camera; back is `direction` (3,). If `direction` is ±y, up is ∓z."""
    upright = np.array([0.0, 1.0, 0.0]) if abs(direction[1]) < 0.999 else np.array([0.0, 0.0, -np.sign(direction[1])])
    right = np.cross(upright, direction)
    right /= np.linalg.norm(right)
    return (-right if flipped else right), np.cross(direction, right), direction


def _sphere(height: Float64, angle: Float64) -> Float64:
    """Return unit vectors (N, 3) with y = `height`, at `angle` in radians about the y axis."""
    ring = np.sqrt(1 - height * height)
    return np.stack([ring * np.cos(angle), height, ring * np.sin(angle)], axis=1)
