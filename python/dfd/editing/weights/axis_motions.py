"""Find the axis of each component of the part that a handle holds, and bend and twist the component along it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64, unit
from dfd.editing.edit import Edit, Handle
from dfd.editing.weights.fill import Band, Column, Component, filled_at_rest, weights_at
from dfd.editing.weights.session_weights import SessionWeights
from dfd.geometry.coarse import nodes_of
from dfd.geometry.part_axis import PartAxes, PartAxis
from dfd.mesh.mesh import Mesh
from dfd.posing.bend import Sections, bend_maps, turn_maps
from dfd.posing.transforms import PivotAt, Transform, Vector, vector
from dfd.symmetry.plane import SymmetryPlane

PART_THRESHOLD = 0.5  # the held part consists of the vertices with at least this fraction of the largest weight
UP = np.array([0.0, 1.0, 0.0])
TOWARDS = {"up": (0, 1, 0), "down": (0, -1, 0), "right": (1, 0, 0), "left": (-1, 0, 0), "front": (0, 0, 1)}
TOWARDS["back"] = (0, 0, -1)
LEAST_ON_SIDE = 0.1  # a component lies across a plane if more than this fraction of its vertices is on each side
ONE_PIECE = 0.9  # least share of a component's area in its largest piece, if the component bends along its axis
UPRIGHT = 0.9  # a component is upright if the cosine of the angle between its axis and the y axis is above this
PARALLEL = 0.01  # sine of the angle to an axis, about 0.6°, below which a direction is parallel: axes are as inaccurate


@dataclass(frozen=True, eq=False)
class BendablePart:
    """One connected component of the part that a handle holds, with its axis."""

    axis: PartAxis  # curve from the base of the component to its tip
    # slender: whether the component bends along its axis. Otherwise, it is stout, round or of several pieces, and bends
    # by rotating as a whole about its base. The rotation grows smoothly from the border.
    slender: bool
    amount: float  # factor in [0, 1] by which the handle's bend and twist are multiplied
    # carry: (3, 3) maps the handle's rotation vectors to this component. The matrix rotates the axis of the component
    # at the handle onto the axis of this component. For a mirror image, the matrix also mirrors the vectors.
    carry: Float64
    handedness: float  # 1, or −1 for a mirror image, which twists in the opposite direction
    sections: Sections  # the vertices of the component in the order along its axis
    across: bool  # whether the component lies across the plane of symmetry
    vertex: int  # the vertex of the counterpart on the component

    def bend(self, points: Float64, transform: Transform) -> None:
        """Bend and twist the vertices of the component in `points` (V, 3), in place, as `transform` defines."""
        turn = self.amount * (self.carry @ np.asarray(transform.bend))
        twist = self.amount * self.handedness * transform.twist
        if self.slender:
            maps = bend_maps(self.axis.nodes, self.axis.radius, turn, twist, transform.joint)
        else:
            maps = turn_maps(self.axis.base, turn + twist * self.axis.direction)
        self.sections.move(points, maps)


def bendable_parts(session: SessionWeights, edit: Edit, handle: Handle) -> list[BendablePart]:
    """Return the connected components that follow a handle of `edit`, the component at the handle first.

    They are those at rest, so they do not depend on motions. Beside handles that move, those components are left out
    which follow another handle. Beyond the plane of symmetry of `edit`, the handle acts mirrored.
    """
    number = edit.number(handle)

    def find() -> list[BendablePart]:
        anchor, own = session.rows.anchor(handle.place), session.columns_of(edit, handle)
        pairs = list(zip(filled_at_rest(own, session.mesh).T, own, strict=True))
        if all(column.component is not None for column in own):
            pieces = [piece for pair in pairs for piece in _pieces(session.axes, pair[0], [pair], anchor)]
        else:  # one component can contain several counterparts, such as fingers of a hand
            pieces = _pieces(session.axes, np.sum([weights for weights, _ in pairs], axis=0), pairs, anchor)
        first = next((i for i, (axis, *_) in enumerate(pieces) if anchor in axis.vertices), 0)
        pieces = [*pieces[first : first + 1], *pieces[:first], *pieces[first + 1 :]]
        return [_part(session.mesh, piece, pieces[0][0], edit.symmetry) for piece in pieces]

    key = (handle.place, handle.controls, edit.fixed, edit.symmetry, edit.preset)
    found = session.rows.kept.get("axes", key, find)
    if number not in edit.sharing:
        return found
    owned = {column.vertex for column in session.plan(edit) if column.handle == number}
    return [part for part in found if part.vertex in owned]


def level_with_axis(session: SessionWeights, edit: Edit, handle: Handle) -> int | None:
    """Return the level nearest to the handle's at which its part bends along an axis; None if there is none."""
    lowest, highest = session.parts_with(edit.symmetry).levels(session.rows.anchor(handle.place))
    for level in sorted(range(lowest, highest + 1), key=lambda level: abs(level - handle.controls.level)):
        other = replace(handle, controls=replace(handle.controls, level=level, reach="part"))
        parts = bendable_parts(session, edit, other)
        if parts and parts[0].slender:
            return level
    return None


def _pieces(
    axes: PartAxes, whole: Float32, columns: Sequence[tuple[Float32, Column]], anchor: int
) -> list[tuple[PartAxis, Column, float]]:
    """Return the components with an axis in the weights `whole` (V,), each with its column and its largest weight."""
    found = []
    for axis in axes.of(whole >= PART_THRESHOLD * whole.max()) if whole.any() else []:
        inside = axis.vertices
        most = int(np.argmax([weights[inside].sum() for weights, _ in columns]))
        column = columns[0 if anchor in inside else most][1]
        found.append((axis, column, min(float(whole[inside].max()), 1.0)))
    return found


def bent(session: SessionWeights, edit: Edit) -> Float64:
    """Return the resting vertices (V, 3), bent and twisted by the handles of `edit`.

    Smaller components bend first. So if a shin and its thigh bend, the thigh moves the bent shin.
    """
    bending = [handle for handle in edit.handles if handle.transform.bends]
    parts = [(part, handle.transform) for handle in bending for part in bendable_parts(session, edit, handle)]
    points = np.array(session.mesh.vertices, np.float64)
    for part, transform in sorted(parts, key=lambda each: len(each[0].axis.vertices)):
        part.bend(points, transform)
    return points


def _part(
    mesh: Mesh, piece: tuple[PartAxis, Column, float], own: PartAxis, plane: SymmetryPlane | None
) -> BendablePart:
    axis, column, amount = piece
    counterpart, flat, across = column.counterpart, np.eye(3), False
    frame = counterpart.frame
    if plane is not None:
        sides = plane.signed_distance(mesh.vertices[axis.vertices])
        negative = float((sides < 0).mean())
        if LEAST_ON_SIDE < negative < 1 - LEAST_ON_SIDE:
            # A component across the plane stays symmetric only if it rotates about the plane's normal.
            across, flat = True, np.outer(plane.normal, plane.normal)
        elif (negative > 0.5) != (float(plane.signed_distance([counterpart.position])[0]) < 0):
            frame = plane.reflection[:3, :3] @ frame
    handedness = float(np.sign(np.linalg.det(frame)))
    turn = np.eye(3)
    slender = own.is_slender and _is_one_piece(mesh, own)
    vertices, parameter = axis.vertices, axis.parameter
    if axis is not own and counterpart.image is not None:
        axis, reversed_ = _as_image(axis, own, counterpart.image)
        parameter = 1.0 - parameter if reversed_ else parameter
    elif axis is not own:
        turn = _turn(frame @ own.direction, axis.direction)
    if not slender and column.component is not None:
        vertices, parameter = _rising(column.component)
    carry = flat @ turn @ (handedness * frame)  # rotation vectors are pseudovectors
    return BendablePart(axis, slender, amount, carry, handedness, Sections(vertices, parameter), across, column.vertex)


def _is_one_piece(mesh: Mesh, axis: PartAxis) -> bool:
    """Return whether nearly all of a component is one piece of the mesh, and not, for example, a horn and an ear."""
    nodes = nodes_of(mesh)
    own = np.unique(nodes.of_vertex[axis.vertices])
    area = np.bincount(nodes.component[own], nodes.area[own])
    return bool(area.max(initial=0.0) >= ONE_PIECE * area.sum())


def _rising(component: Component) -> tuple[Int64, Float64]:
    """Return the vertices (N,) of a component, and a parameter that rises from 0 at its border to 1 inside."""
    vertices = np.concatenate([component.core.vertices, component.vertices]).astype(np.int64)
    depth = np.concatenate([np.full(len(component.core.vertices), np.inf, np.float32), component.depth])
    share = np.concatenate([component.core.values, component.share])
    parameter = (share * weights_at(depth, Band(0.0, component.inward))).astype(np.float64)
    order = np.argsort(vertices)
    return vertices[order], parameter[order]


def _as_image(axis: PartAxis, own: PartAxis, isometry: Float64) -> tuple[PartAxis, bool]:
    """Return `axis` with the curve of `own`, the axis at the handle, moved by `isometry` (3, 4).

    So a counterpart moves exactly as the mirror image of the handle's component, but its vertices and their parameters
    are its own. Also return whether the parameters run in the opposite direction.
    """
    linear, shift = isometry[:, :3], isometry[:, 3]
    moved = {name: getattr(own, name) @ linear.T + shift for name in ("nodes", "border", "middle", "rest")}
    ends = np.linalg.norm(moved["nodes"][[0, -1]] - axis.nodes[0], axis=1)
    return replace(axis, radius=own.radius, **moved), bool(ends[1] < ends[0])


def _turn(one: Float64, other: Float64) -> Float64:
    """Return a rotation (3, 3) of `one` onto `other`. If neither is upright, horizontal normals stay horizontal.

    The result is the identity if one of them is 0, because the axis of a damaged part can have no length.
    """
    if not (one.any() and other.any()):
        return np.eye(3)
    if max(abs(one @ UP), abs(other @ UP)) > UPRIGHT:
        return np.asarray(Rotation.align_vectors(other, one)[0].as_matrix(), np.float64)
    frames = []
    for direction in (one, other):
        across = unit(np.cross(direction, UP)[None])[0]
        frames.append(np.stack([direction, across, np.cross(direction, across)], axis=1))
    return frames[1] @ frames[0].T


def bend_vector(part: BendablePart, angle: float, towards: Any = None) -> Vector:
    """Return the rotation vector, in degrees, that bends `part`, the component at the handle, by an angle in degrees.

    The tip moves `towards` a direction (3,) or a name in `TOWARDS`. By default, it moves up. The tip of an upright
    component moves to the front.

    Raises ValueError if `towards` is no direction or name, or is parallel to the axis of `part`.
    """
    along = part.axis.direction
    if towards is None:
        towards = "front" if abs(along @ UP) > UPRIGHT else "up"
    if isinstance(towards, str) and towards not in TOWARDS:
        raise ArgumentError("towards", f"must be {', '.join(TOWARDS)} or 3 numbers, got {towards!r}")
    wanted = vector("towards", TOWARDS[towards] if isinstance(towards, str) else towards)
    about = np.cross(along, unit(np.array([wanted]))[0])
    if np.linalg.norm(about) < PARALLEL:
        raise ArgumentError("towards", "must not be parallel to the axis of the held part")
    return vector("bend", check.number(None, "bend", angle) * unit(about[None])[0])


def pivot_on(
    part: BendablePart | None, which: PivotAt | None, handle: Handle, plane: SymmetryPlane | None
) -> tuple[Vector, PivotAt]:
    """Return a pivot on `part`, the component at the handle, and the kind of the pivot.

    If `which` is None, the pivot is the base of a limb, the point between the two borders of a part such as a teapot's
    handle, or else the middle. If `part` lies across the symmetry plane, this default pivot is projected onto the
    plane. The kinds "point" and "plane" need no part.

    Raises ValueError if `which` is "plane" and the edit has no plane.
    """
    point, chosen, projected = np.asarray(handle.place.position), which, which == "plane"
    if part is not None:
        axis = part.axis
        chosen = which or ("base" if axis.is_limb or axis.borders == 2 else "middle")
        point = {"base": axis.base, "middle": axis.middle, "hinge": axis.hinge[0]}.get(chosen, point)
        projected |= which is None and part.across
    assert chosen is not None, "only a part has a default pivot"
    if projected:
        if plane is None:
            raise ArgumentError("pivot", "cannot be 'plane': the edit has no plane of symmetry")
        point = point - float(plane.signed_distance([point])[0]) * np.asarray(plane.normal)
    return vector("pivot", point), chosen
