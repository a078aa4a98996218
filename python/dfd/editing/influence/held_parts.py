"""The parts that a handle holds, each with its own axis: what bend and twist run along, and pivots lie on."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import unit
from dfd.editing.influence.instance_weights import Column
from dfd.editing.influence.instances import LEAST_ALIKE, shortest_turn
from dfd.geometry.part_axis import PartAxes, PartAxis
from dfd.posing.bend import Sections, bend_maps

if TYPE_CHECKING:
    from dfd.editing.edit import Edit, Handle
    from dfd.mesh.mesh import Mesh
    from dfd.posing.transforms import Transform
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["HeldPart", "HeldParts"]

HELD = 0.5  # of the most that follows a handle there: the part ends where less does
UP = np.array([0.0, 1.0, 0.0])
UPRIGHT = 0.9  # cosine: of a limb that is nearer to upright, up says nothing about the way that it bends

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeldPart:
    """One connected part that follows a handle.

    Attributes
    ----------
    axis
        From where it leaves the rest of the shape to its tip.
    amount
        How much of the handle's bend and twist it makes, in [0, 1].
    carry
        (3, 3) takes the handle's rotation vectors to those of this part: turned from one axis to the other, and
        mirrored where the part is a mirror image.
    handedness
        1, or −1 for a mirror image, which twists the other way.
    sections
        Its vertices by where along the axis they are.
    """

    axis: PartAxis
    amount: float
    carry: Float64
    handedness: float
    sections: Sections

    def bend(self, points: Float64, transform: Transform) -> None:
        """Bend and twist what of `points` (V, 3) belongs to the part, in place, as `transform` says."""
        turn = self.amount * (self.carry @ np.asarray(transform.bend))
        twist = self.amount * self.handedness * transform.twist
        self.sections.move(points, bend_maps(self.axis.nodes, self.axis.radius, turn, twist, transform.joint))


class HeldParts:
    """The parts of the handles of one mesh, kept as long as what they depend on stays."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._axes = PartAxes(mesh)
        self._found: dict[Hashable, list[HeldPart]] = {}

    def of(
        self,
        key: Hashable,
        handle: Handle,
        anchor: int,
        columns: Sequence[tuple[Float32, Column]],
        plane: SymmetryPlane | None,
    ) -> list[HeldPart]:
        """The parts that a handle holds, the one that it stands on first.

        Parameters
        ----------
        key
            All that they depend on.
        handle, anchor
            The handle, and the vertex by which it is judged.
        columns
            (V,) what follows it, by instance, its own first, and what each is of.
        plane
            Of the edit's symmetry: across it handles act mirrored.
        """
        if key in self._found:
            self._found[key] = self._found.pop(key)  # the last to be forgotten
            return self._found[key]
        pieces: list[tuple[PartAxis, Column, float]] = []
        most = max((float(column.max(initial=0.0)) for column, _ in columns), default=0.0)
        for weights, column in columns:
            top = float(weights.max(initial=0.0))
            if top < LEAST_ALIKE * most or top == 0.0:
                continue
            for axis in self._axes.of(weights >= HELD * top):
                pieces.append((axis, column, min(float(weights[axis.vertices].max()), 1.0)))
        own = next((i for i, (axis, *_) in enumerate(pieces) if anchor in axis.vertices), 0)
        pieces = [*pieces[own : own + 1], *pieces[:own], *pieces[own + 1 :]]
        found = [self._part(piece, pieces[0][0], handle, plane) for piece in pieces]
        while len(self._found) > 64:
            del self._found[next(iter(self._found))]
        self._found[key] = found
        return found

    def bent(self, edit: Edit, parts: dict[int, list[HeldPart]]) -> Float64:
        """(V, 3) the resting vertices, bent and twisted by the handles of `edit` that do, whose `parts` are given.

        What lies in several parts is bent by the smallest first: a shin goes along with its thigh.
        """
        bending = [(part, edit.handles[i].transform) for i, of_handle in parts.items() for part in of_handle]
        points = np.array(self._mesh.vertices, np.float64)
        for part, transform in sorted(bending, key=lambda each: len(each[0].axis.vertices)):
            part.bend(points, transform)
        return points

    def _part(
        self, piece: tuple[PartAxis, Column, float], own: PartAxis, handle: Handle, plane: SymmetryPlane | None
    ) -> HeldPart:
        axis, column, amount = piece
        frame = np.eye(3) if column.instance is None else column.instance.frame
        flat = np.eye(3)
        if plane is not None:
            sides = plane.signed_distance(self._mesh.vertices[axis.vertices])
            less = float((sides < 0).mean())
            if 0.1 < less < 0.9:  # lies across the plane: what both sides do alike is left, a turn about its normal
                flat = np.outer(plane.normal, plane.normal)
            elif (less > 0.5) != (float(plane.signed_distance([column.position(handle)])[0]) < 0):
                frame = plane.reflection[:3, :3] @ frame
        handedness = float(np.sign(np.linalg.det(frame)))
        turn = np.eye(3) if axis is own else _turn(frame @ own.direction, axis.direction)
        carry = flat @ turn @ (handedness * frame)  # a rotation vector is mirrored as a pseudovector
        return HeldPart(axis, amount, carry, handedness, Sections(axis.vertices, axis.parameter))


def _turn(one: Float64, other: Float64) -> Float64:
    """(3, 3) the rotation of a direction onto another one that keeps up what is up, where both lie flat enough."""
    if max(abs(one @ UP), abs(other @ UP)) > UPRIGHT:
        return shortest_turn(one, other)
    frames = []
    for direction in (one, other):
        across = unit(np.cross(direction, UP)[None])[0]
        frames.append(np.stack([direction, across, np.cross(direction, across)], axis=1))
    turn: Float64 = frames[1] @ frames[0].T
    return turn
