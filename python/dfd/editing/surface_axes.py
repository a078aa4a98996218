"""Axes along the surface, normal or limb, at a handle and at each of its instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dfd.editing.distances import Distances
from dfd.editing.edit import Handle
from dfd.editing.instances import LEAST_ALIKE, Instance
from dfd.posing.transforms import Along, Frame, frame_of_normal

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["SurfaceAxes"]

Float64 = NDArray[np.float64]


class SurfaceAxes:
    """Which way the normal and the limb run at the vertices of one mesh."""

    def __init__(self, mesh: Mesh, distances: Distances) -> None:
        self._mesh = mesh
        self._distances = distances

    def at(self, vertex: int, along: Along) -> Frame | None:
        """Three axes, right-handed, whose third runs along the surface's normal or the limb at a vertex, if it can."""
        direction, _ = self._direction(vertex, along)
        return None if direction is None else frame_of_normal(direction)

    def turned(self, handle: Handle, anchor: int, instances: Sequence[Instance]) -> tuple[Instance, ...]:
        """`instances` of a handle, each but the first with its frame turned the shortest way to its own normal or limb.

        `anchor` is the handle's vertex. Where an instance has none, or is hardly alike, its frame stays.
        """
        axes, along = handle.transform.axes, handle.transform.along
        if axes is None or along is None:
            return tuple(instances)
        third = np.asarray(axes[2])
        own, own_told = self._direction(anchor, along)
        # Axes from a file may run the other way than they do here.
        sign = 1.0 if own is None or own @ third >= 0 else -1.0
        found = list(instances[:1])
        for one in instances[1:]:
            theirs, told = self._direction(one.vertex, along) if one.weight >= LEAST_ALIKE else (None, False)
            if theirs is None:
                found.append(one)
                continue
            carried = one.frame @ third
            target = sign * theirs
            if not (told and own_told) and carried @ target < 0:
                target = -target
            found.append(replace(one, frame=_shortest_turn(carried, target) @ one.frame))
        return tuple(found)

    def _direction(self, vertex: int, along: Along) -> tuple[Float64 | None, bool]:
        """The direction (3,), of length 1, if there is one, and whether it is told from its opposite."""
        if along == "normal":
            normal = np.asarray(self._mesh.normals[vertex], np.float64)
            return (normal, True) if normal.any() else (None, False)
        limb = self._distances.limb(vertex)
        return (None, False) if limb is None else (limb.direction, limb.at_end)


def _shortest_turn(one: Float64, other: Float64) -> Float64:
    """(3, 3) the rotation by the smallest angle of `one` (3,) onto `other` (3,), both of length 1."""
    across = np.cross(one, other)
    sine, cosine = float(np.linalg.norm(across)), float(one @ other)
    if sine < 1e-9:
        # Opposite: about the axis of y, or what of it lies across, so that what stands upright stays so.
        across = np.asarray(frame_of_normal(one)[0]) if abs(one[1]) > 0.9 else np.array([0.0, 1.0, 0.0])
        across = across - (across @ one) * one
        sine, length = 0.0, float(np.linalg.norm(across))
    else:
        length = sine
    turn: Float64 = Rotation.from_rotvec(across / length * np.arctan2(sine, cosine)).as_matrix()
    return turn
