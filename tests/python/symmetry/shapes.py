"""Make shapes and fields with known symmetries."""

from collections.abc import Callable

import numpy as np
import trimesh

from dfd.mesh.mesh import Mesh

Fold = Callable[[np.ndarray], np.ndarray]


class FoldedField:
    """A field of smooth features. They are equal at points that `fold` maps to the same point."""

    def __init__(self, fold: Fold, turn: np.ndarray | None = None, offset: tuple[float, float, float] = (0, 0, 0)):
        self._fold, self._turn, self._offset = fold, np.eye(3) if turn is None else turn, np.asarray(offset)
        self._waves = np.random.default_rng(5).normal(size=(3, 40))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        local = (np.asarray(points, np.float64) - self._offset) @ self._turn
        angles = self._fold(local) @ self._waves
        rows = np.concatenate([np.cos(angles), np.sin(angles)], axis=1)
        return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def mirror_x(points: np.ndarray) -> np.ndarray:
    return np.abs(points) * [1, 0, 0] + points * [0, 1, 1]


def mirror_xz(points: np.ndarray) -> np.ndarray:
    return np.abs(points) * [1, 0, 1] + points * [0, 1, 0]


def about_y(order: int) -> Fold:
    def fold(points: np.ndarray) -> np.ndarray:
        radius, angle = np.hypot(points[:, 0], points[:, 2]), np.arctan2(points[:, 2], points[:, 0])
        return np.column_stack([radius * np.cos(order * angle), points[:, 1], radius * np.sin(order * angle)])

    return fold


def _mesh(parts: list[trimesh.Trimesh], turn: np.ndarray | None, offset: tuple[float, float, float]) -> Mesh:
    whole = trimesh.util.concatenate(parts)
    turned = whole.vertices if turn is None else whole.vertices @ turn.T
    return Mesh(turned + offset, whole.faces)


def box(size: tuple[float, float, float], place: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(size).subdivide().subdivide().apply_translation(place)


def creature(turn: np.ndarray | None = None, offset: tuple[float, float, float] = (0, 0, 0), *, armed: bool = False):
    """Return a body with a head, two arms and two legs, symmetric in x = 0. If `armed`, one hand holds a bow."""
    parts = [box((1, 1.6, 0.5), (0, 0, 0)), box((0.6, 0.5, 0.8), (0, 1.05, 0.3))]
    for side in (-1, 1):
        parts += [box((0.7, 0.25, 0.25), (side * 0.85, 0.5, 0.1)), box((0.3, 1.0, 0.35), (side * 0.3, -1.3, 0))]
    if armed:
        parts += [box((0.2, 0.2, 1.6), (1.25, 0.5, 0.8)), box((1.2, 0.1, 0.1), (1.25, 0.5, 1.4))]
    return _mesh(parts, turn, offset)


def table(legs: int, turn: np.ndarray | None = None, offset: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    """Return a round table top with `legs` legs around the y axis."""
    top = trimesh.creation.cylinder(1.0, 0.1, sections=60 * legs).apply_transform(
        trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0))
    )
    parts = [top.apply_translation((0, 0.5, 0))]
    for number in range(legs):
        leg = box((0.15, 1.0, 0.15), (0.8, 0, 0))
        parts.append(leg.apply_transform(trimesh.transformations.rotation_matrix(2 * np.pi * number / legs, (0, 1, 0))))
    return _mesh(parts, turn, offset)
