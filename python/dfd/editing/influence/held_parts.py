"""The parts that a handle holds. Each has an axis, along which it bends and twists."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, unit
from dfd.editing.edit import Edit, Handle
from dfd.editing.influence.counterparts import Column
from dfd.geometry.part_axis import PartAxes, PartAxis
from dfd.mesh.mesh import Mesh
from dfd.posing.bend import Sections, bend_maps
from dfd.posing.transforms import PivotAt, Transform, Vector, frame_of_normal, vector
from dfd.symmetry.plane import SymmetryPlane

HELD = 0.5  # a part ends where the weight falls below this share of its maximum
UP = np.array([0.0, 1.0, 0.0])
# Directions for `towards`. y is up, the front is +z, and left is −x.
TOWARDS = {"up": (0, 1, 0), "down": (0, -1, 0), "right": (1, 0, 0), "left": (-1, 0, 0), "front": (0, 0, 1)}
TOWARDS["back"] = (0, 0, -1)
ACROSS = 0.1  # a part lies across a plane if each side has more than this share of its vertices
UPRIGHT = 0.9  # cosine of the angle to y above which a part is upright; by default, it bends to the front


@dataclass(frozen=True, eq=False)
class HeldPart:
    """One connected part that follows a handle."""

    axis: PartAxis  # from the base of the part to its tip
    amount: float  # the share of the handle's bend and twist that the part makes, in [0, 1]
    # carry: (3, 3) maps the handle's rotation vectors to this part. It rotates the axis of the handle's own
    # part onto this axis, and mirrors rotation vectors if the part is a mirror image.
    carry: Float64
    handedness: float  # 1, or −1 for a mirror image, which twists the other way
    sections: Sections  # the vertices of the part in the order along its axis
    across: bool  # whether the part lies across the plane of symmetry

    def bend(self, points: Float64, transform: Transform) -> None:
        """Bend and twist the vertices of the part in `points` (V, 3), in place, as `transform` says."""
        turn = self.amount * (self.carry @ np.asarray(transform.bend))
        twist = self.amount * self.handedness * transform.twist
        self.sections.move(points, bend_maps(self.axis.nodes, self.axis.radius, turn, twist, transform.joint))


def held_parts(
    mesh: Mesh, axes: PartAxes, anchor: int, columns: Sequence[tuple[Float32, Column]], plane: SymmetryPlane | None
) -> list[HeldPart]:
    """Return the parts that a handle holds, its own part first; the vertex `anchor` stands for the handle.

    `columns` are the weights (V,) of each counterpart, the handle's own first, with its column. Handles act mirrored
    across `plane`.
    """
    # Several counterparts can lie on one connected part, as fingers on a hand. So parts come from the sum of weights.
    whole = np.sum([weights for weights, _ in columns], axis=0)
    pieces: list[tuple[PartAxis, Column, float]] = []
    images = {column: image for _, column in columns if (image := column.counterpart.image) is not None}
    for axis in axes.of(whole >= HELD * whole.max()) if whole.any() else []:
        inside = axis.vertices
        most = int(np.argmax([weights[inside].sum() for weights, _ in columns]))
        pieces.append((axis, columns[0 if anchor in inside else most][1], min(float(whole[inside].max()), 1.0)))
    own = next((i for i, (axis, *_) in enumerate(pieces) if anchor in axis.vertices), 0)
    others = [*pieces[:own], *pieces[own + 1 :]]
    if pieces and images:
        others = [piece for piece in others if piece[1] is not pieces[own][1] and piece[1] not in images]
        held = pieces[own][0], pieces[own][2]
        others += [(axes.image(held[0], image), column, held[1]) for column, image in images.items()]
    pieces = [*pieces[own : own + 1], *others]
    return [_part(mesh, piece, pieces[0][0], plane) for piece in pieces]


def bent(mesh: Mesh, edit: Edit, parts: dict[int, list[HeldPart]]) -> Float64:
    """Return (V, 3) the vertices of `mesh`, bent and twisted by the handles of `edit` that have `parts`.

    Smaller parts bend first, so that a thigh also moves its bent shin.
    """
    bending = [(part, edit.handles[i].transform) for i, of_handle in parts.items() for part in of_handle]
    points = np.array(mesh.vertices, np.float64)
    for part, transform in sorted(bending, key=lambda each: len(each[0].axis.vertices)):
        part.bend(points, transform)
    return points


def _part(mesh: Mesh, piece: tuple[PartAxis, Column, float], own: PartAxis, plane: SymmetryPlane | None) -> HeldPart:
    axis, column, amount = piece
    counterpart, flat, across = column.counterpart, np.eye(3), False
    frame = counterpart.frame
    if plane is not None:
        sides = plane.signed_distance(mesh.vertices[axis.vertices])
        less = float((sides < 0).mean())
        if ACROSS < less < 1 - ACROSS:
            # If a part lies across the plane, only a rotation about the plane's normal is symmetric.
            across, flat = True, np.outer(plane.normal, plane.normal)
        elif (less > 0.5) != (float(plane.signed_distance([counterpart.position])[0]) < 0):
            frame = plane.reflection[:3, :3] @ frame
    handedness = float(np.sign(np.linalg.det(frame)))
    turn = np.eye(3) if axis is own or counterpart.image is not None else _turn(frame @ own.direction, axis.direction)
    carry = flat @ turn @ (handedness * frame)  # a rotation vector is mirrored as a pseudovector
    return HeldPart(axis, amount, carry, handedness, Sections(axis.vertices, axis.parameter), across)


def _turn(one: Float64, other: Float64) -> Float64:
    """Return (3, 3) a rotation of `one` onto `other`. Horizontal normals stay horizontal unless one is upright."""
    if max(abs(one @ UP), abs(other @ UP)) > UPRIGHT:
        return _shortest_turn(one, other)
    frames = []
    for direction in (one, other):
        across = unit(np.cross(direction, UP)[None])[0]
        frames.append(np.stack([direction, across, np.cross(direction, across)], axis=1))
    return frames[1] @ frames[0].T


def _shortest_turn(one: Float64, other: Float64) -> Float64:
    """Return the smallest rotation (3, 3) from `one` (3,) to `other` (3,), both of length 1."""
    across = np.cross(one, other)
    sine, cosine = float(np.linalg.norm(across)), float(one @ other)
    if sine < 1e-9:
        # For equal or opposite directions, the axis is perpendicular to `one`: nearly y, unless `one` is upright.
        across = np.asarray(frame_of_normal(one)[0]) if abs(one[1]) > 0.9 else UP
        across, sine = across - (across @ one) * one, 0.0
    return Rotation.from_rotvec(across / np.linalg.norm(across) * np.arctan2(sine, cosine)).as_matrix()


def bend_vector(part: HeldPart, angle: float, towards: Any = None) -> Vector:
    """Return the rotation vector, in degrees, that bends a handle's own part by an angle.

    The tip moves `towards` a direction (3,) or a word of `TOWARDS`. If left out, it moves up, or to the front for an
    upright part.

    Raises ValueError if `towards` is neither, or the part itself runs in that direction.
    """
    along = part.axis.direction
    if towards is None:
        towards = "front" if abs(along @ UP) > UPRIGHT else "up"
    if isinstance(towards, str) and towards not in TOWARDS:
        raise ArgumentError("towards", f"must be {', '.join(TOWARDS)} or 3 numbers, got {towards!r}")
    wanted = vector("towards", TOWARDS[towards] if isinstance(towards, str) else towards)
    about = np.cross(along, unit(np.array([wanted]))[0])
    if np.linalg.norm(about) < 1e-3:
        raise ArgumentError("towards", "must not be parallel to the axis of the held part")
    return vector("bend", check.number(None, "bend", angle) * unit(about[None])[0])


def pivot_on(
    part: HeldPart, which: PivotAt | None, handle: Handle, plane: SymmetryPlane | None
) -> tuple[Vector, PivotAt]:
    """Return a pivot on a handle's own part, and its kind. None chooses the base of a limb, else the middle.

    For a part across the plane of symmetry, this choice is moved onto the plane.

    Raises ValueError if `which` is "plane" and the edit has no plane.
    """
    point = np.asarray(handle.place.position)
    axis = part.axis
    chosen: PivotAt = which or ("base" if axis.is_limb else "middle")
    if chosen == "plane" and plane is None:
        raise ArgumentError("pivot", "cannot be 'plane': the edit has no plane of symmetry")
    if chosen != "point":
        point = {"base": axis.base, "middle": axis.middle, "hinge": axis.hinge[0], "plane": point}[chosen]
    if plane is not None and (chosen == "plane" or (which is None and part.across)):
        point = point - float(plane.signed_distance([point])[0]) * np.asarray(plane.normal)
    return vector("pivot", point), chosen
