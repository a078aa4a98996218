"""Place cameras around a shape, in directions on a Fibonacci sphere, so that the shape fills each picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64

Framing = Literal["shape", "paper"]

FIELD_OF_VIEW = 60.0  # degrees, as in the paper and the public reference
PAPER_DISTANCE = 2.8  # from the origin, normalized, as in the paper and the public reference
MARGIN = 1.06  # width of the picture over that of the shape, so that no patch at the outline is cut
CLEARANCE = 0.2  # of half the shape's size: least distance from the eye, also for a needle seen from its tip
_MIRROR_IMAGES = np.array([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]])
_CHUNK = 1 << 12  # points per product, so that products stay in the cache


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with a square picture, in normalized coordinates."""

    position: Float64  # (3,) the eye
    # right, up, back: (3,) orthonormal axes; the camera looks along −`back`. A mirrored camera has `right` negated, so
    # its picture is the mirror image.
    right: Float64
    up: Float64
    back: Float64
    field_of_view: float = FIELD_OF_VIEW  # full angle across the picture, degrees

    @property
    def half_width(self) -> float:
        """Return half the width of the picture at distance 1."""
        return float(np.tan(np.radians(self.field_of_view) / 2))

    def ray_directions(self, resolution: int) -> Float32:
        """Return unit directions (R², 3) through the centers of the pixels, row by row from the top left."""
        across = ((np.arange(resolution) + 0.5) / resolution * 2 - 1) * self.half_width
        x, y = np.tile(across, resolution), np.repeat(-across, resolution)
        # NumPy is slow if the last axis has length three, so the long axis is last until the end.
        local = np.stack([x, y, np.full(len(x), -1.0)]) / np.sqrt(1 + x * x + y * y)
        return np.ascontiguousarray((np.array([self.right, self.up, self.back]).T @ local).T, np.float32)

    def in_mesh(self, frame: Float64) -> Camera:
        """Return this camera in the mesh's coordinates; its own axes are the rows of `frame` (3, 3) in them."""
        axes = (self.position @ frame, self.right @ frame, self.up @ frame, self.back @ frame)
        return Camera(*axes, self.field_of_view)

    def project(self, points: NDArray[np.floating[Any]], resolution: int) -> tuple[Float64, Float64]:
        """Return the row (N,) and column (N,), in pixels, of `points` (N, 3); whole numbers are pixel centers."""
        offset = points - self.position
        depth = -(offset @ self.back) * self.half_width
        column = (offset @ self.right / depth + 1) / 2 * resolution - 0.5
        row = (1 - offset @ self.up / depth) / 2 * resolution - 0.5
        return row, column


def fibonacci_directions(count: int, *, mirrored: bool = False) -> Float64:
    """Return unit directions (count, 3), spread evenly over the sphere.

    With `mirrored`, they are a quarter of the directions, and its mirror images at x = 0, at z = 0 and at both. The
    remainder of `count` over four lies in these planes.

    Raises ValueError if `count` is less than 1.
    """
    count = check.whole("fibonacci_directions", "count", count, minimum=1)
    if not mirrored:
        index = np.arange(count) + 0.5
        return _sphere(1 - 2 * index / count, np.pi * (1 + np.sqrt(5)) * index)
    # A Fibonacci spiral comes close to its mirror images at the planes. Few meridians, taken in turn, do not.
    index = np.arange(count // 4) + 0.5
    meridians = max(2, round(np.sqrt(len(index) / 2.5)))
    quarter = _sphere(1 - 2 * index / max(len(index), 1), np.pi / 2 * (index % meridians) / meridians)
    sides = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])[: count % 4 // 2 * 2]
    front = np.array([[0.0, 0.0, 1.0]])[: count % 2]
    return np.concatenate([*(quarter * signs for signs in _MIRROR_IMAGES), sides, front])


def camera_towards(
    direction: ArrayLike, points: NDArray[np.floating[Any]], *, field_of_view: float = FIELD_OF_VIEW
) -> Camera:
    """Return a camera in `direction` (3,), of any length, that sees all `points` (N, 3); see `place_cameras`.

    Raises ValueError if `direction` has length 0.
    """
    unit = check.array("camera_towards", "direction", direction, (3,), dtype=np.float64)
    length = np.linalg.norm(unit)
    if length == 0:
        raise ValueError("camera_towards: `direction` must have a length, got 0, 0, 0")
    return _place(unit[None] / length, points, "shape", field_of_view, np.zeros(1, bool))[0]


def place_cameras(
    count: int, points: NDArray[np.floating[Any]], *, framing: Framing = "shape", mirrored: bool = False
) -> list[Camera]:
    """Place `count` cameras around a shape of vertices `points` (N, 3), in normalized coordinates.

    `framing` "shape" takes the smallest distance at which the picture contains the whole shape with a small margin. No
    point is then nearer to the eye than a tenth of the shape's size. "paper" takes a distance of 2.8 from the origin,
    and looks at the origin.

    With `mirrored`, cameras form groups of four that are mirror images of each other at x = 0 and z = 0. The pictures
    of a shape that is symmetric at one of these planes then show both sides alike.

    Raises ValueError if `count` is not at least 1 or `framing` is unknown.
    """
    directions = fibonacci_directions(count, mirrored=mirrored)
    x, z = directions[:, 0], directions[:, 2]
    flipped = mirrored & ((x * z < 0) | ((z == 0) & (x < 0)))  # mirrored an odd number of times
    return _place(directions, points, framing, FIELD_OF_VIEW, flipped)


def _place(
    directions: Float64, points: NDArray[np.floating[Any]], framing: Framing, field_of_view: float, flipped: Bool
) -> list[Camera]:
    check.choice("place_cameras", "framing", framing, Framing)
    field_of_view = check.number("place_cameras", "field_of_view", field_of_view, minimum=1.0, maximum=170.0)
    bases = [_basis(direction, turn) for direction, turn in zip(directions, flipped, strict=True)]
    if framing == "paper":
        return [Camera(PAPER_DISTANCE * basis[2], *basis, field_of_view) for basis in bases]
    slope = np.tan(np.radians(field_of_view) / 2) / MARGIN
    # A point q (right, up, back) is inside the picture from distance d and center c if |q_x − c_x| ≤ slope (d − q_z),
    # and likewise in y. The bounds are linear in the point, so one matrix product gives the extremes for all cameras.
    # The fifth bound is the point nearest to the eye.
    bounds = [
        [right + slope * back, slope * back - right, up + slope * back, slope * back - up, back]
        for right, up, back in bases
    ]
    reach = _largest_along(np.concatenate([*bounds, np.eye(3), -np.eye(3)]), points)
    clearance = CLEARANCE * float((reach[-6:-3] + reach[-3:]).max()) / 2
    reach = reach[:-6].reshape(-1, 5)
    cameras = []
    for (right, up, back), (to_right, to_left, to_top, to_bottom, nearest) in zip(bases, reach, strict=True):
        distance = max((to_right + to_left) / (2 * slope), (to_top + to_bottom) / (2 * slope), nearest + clearance)
        position = (to_right - to_left) / 2 * right + (to_top - to_bottom) / 2 * up + distance * back
        cameras.append(Camera(position, right, up, back, field_of_view))
    return cameras


def _largest_along(normals: Float64, points: NDArray[np.floating[Any]]) -> Float64:
    """Return the largest products (K,) of any of `points` (N, 3) with each of `normals` (K, 3)."""
    rows = normals.astype(np.float32)
    largest = np.full(len(normals), -np.inf, np.float32)
    for start in range(0, len(points), _CHUNK):
        chunk = np.asarray(points[start : start + _CHUNK], np.float32)
        np.maximum(largest, (rows @ chunk.T).max(axis=1), out=largest)
    return largest.astype(np.float64)


def _basis(direction: Float64, flipped: bool) -> tuple[Float64, Float64, Float64]:
    """Return right, up and back of an upright camera in `direction` (3,); straight above, −z is up."""
    upright = np.array([0.0, 1.0, 0.0]) if abs(direction[1]) < 0.999 else np.array([0.0, 0.0, -np.sign(direction[1])])
    right = np.cross(upright, direction)
    right /= np.linalg.norm(right)
    return (-right if flipped else right), np.cross(direction, right), direction


def _sphere(height: Float64, angle: Float64) -> Float64:
    ring = np.sqrt(1 - height * height)
    return np.stack([ring * np.cos(angle), height, ring * np.sin(angle)], axis=1)
