"""Convert a session to a rig: joints, and the weights with which vertices follow them (Eq. 1 and 8)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit, Handle, box_center
from dfd.editing.key_pose import KeyPose
from dfd.editing.shape import PosedShape
from dfd.editing.weights.fill import Band, Column, widest
from dfd.export.joints import Joint
from dfd.export.key_poses import Step, posed_edit
from dfd.mesh.file.edits import far_origin
from dfd.mesh.file.text import UniqueNames
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Transform
from dfd.symmetry.plane import SymmetryPlane

BATCH = 1 << 14  # vertices per batch; batches avoid a second array as large as all weights


@dataclass(frozen=True, eq=False)
class Rig:
    """Joints, and the weights with which vertices follow them."""

    mesh: Mesh  # the resting shape
    edit: Edit
    # the root, which never moves and is the parent of all others; the joint of D₀, if any; then the joints of handles
    joints: tuple[Joint, ...]
    origin: Float64  # (3,) mesh units; files store vertices minus `origin`. It is 0 unless vertices are far from 0
    default: int  # index of the joint whose weight is 1 minus all other weights: the joint of D₀, or else the root
    poses: tuple[KeyPose, ...]  # key poses, ordered by time
    _posed: PosedShape
    _weights: Float32  # (V, C) weights of the session, one or more columns for each handle
    _column: Int64  # (J − default − 1,) column of `_weights` for each joint after `default`
    _on_negative_side: Bool  # (J − default − 1,) whether this joint acts on the negative side of the plane

    def weights(self) -> Iterator[tuple[slice, Float64]]:
        """Yield slices of N vertices, and the weights (N, J) with which they follow the joints in `dfd.pose`.

        The weights of a vertex sum to 1, or to more than 1 if the weights of the handles alone do so.
        """
        plane = self.edit.symmetry
        first = self.default + 1
        for start in range(0, len(self._weights), BATCH):
            rows = slice(start, min(start + BATCH, len(self._weights)))
            blended = self._weights[rows].astype(np.float64)
            total = blended.sum(axis=1, keepdims=True)
            result = np.zeros((len(blended), len(self.joints)))
            result[:, self.default] = np.maximum(1.0 - total[:, 0], 0.0)
            result[:, first:] = blended[:, self._column]
            if plane is not None:
                side = _side(plane, self.mesh.vertices[rows])[:, None]
                result[:, first:] *= np.where(self._on_negative_side, 1.0 - side, side)
            yield rows, result

    def moments(self) -> Iterator[tuple[str, Edit]]:
        """Yield the name and the edit of each pose: first the present edit, then each key pose."""
        yield "the edit", self.edit
        for number, pose in enumerate(self.poses):
            passed = sum(isinstance(each, Step) for each in self.poses[:number])
            yield pose.name or f"key pose {number + 1 - passed}", posed_edit(self.edit, pose)

    def posed(self, edit: Edit) -> Float64:
        """Return the result (V, 3) of `dfd.pose` for `edit`, which differs from the rig's edit only in transforms."""
        return self._posed.of(edit)

    def transforms(self, edit: Edit) -> list[Transform]:
        """Return for each joint the transform of its handle in `edit`; for the joint of D₀, return D₀."""
        rest = Transform()
        of_handle = {handle.id: handle.transform for handle in edit.handles}
        found = [rest if joint.handle is None else of_handle[joint.handle] for joint in self.joints]
        if edit.default is not None:
            found[self.default] = edit.default
        return found


def rig_of(session: Deformer, poses: Sequence[KeyPose] = ()) -> Rig:
    """Return the rig of a session's present edit.

    A handle has a joint for each of its columns of weights, usually one for each counterpart. With a plane of symmetry,
    each column has a second joint for its mirror image.
    """
    edit = session.edit
    moves = {
        handle.id: [handle.transform, *(pose.transforms[handle.id] for pose in poses if handle.id in pose.transforms)]
        for handle in edit.handles
    }
    # All poses share the weights. So blend bands, where weights fall at borders of parts, get the largest sizes needed.
    bands = _widest([edit, *(posed_edit(edit, pose) for pose in poses)], session)
    weights, columns = _one_for_each_pivot(*session.bound.columns(edit, bands))
    names, center, far = UniqueNames(), box_center(session.mesh), far_origin(session.mesh.vertices)
    origin = np.zeros(3) if far is None else far
    joints = [Joint(names.unique("root"), None, center, origin, np.eye(3), np.eye(4))]
    if edit.default is not None:
        pivot = np.asarray(center if edit.default.pivot is None else edit.default.pivot)
        joints.append(Joint(names.unique("default"), None, center, pivot, _frame([edit.default]), np.eye(4)))
    default = len(joints) - 1
    plane, of_column, mirrored = edit.symmetry, list[int](), list[bool]()
    for number, column in enumerate(columns):
        handle = edit.handles[column.handle]
        name, pivot = handle.name or f"handle {handle.id}", np.asarray(handle.pivot)
        carry, frame = _carry(column, handle), _frame(moves[handle.id])
        # The joint of a counterpart acts on one side of the plane, and the joint of its mirror image on the other side.
        below = plane is not None and bool(np.dot(column.counterpart.position, plane.normal) < plane.offset)
        for mirror in (False,) if plane is None else (False, True):
            image = plane.reflection @ carry if plane is not None and mirror else carry
            named = names.unique(f"{name} mirrored" if mirror else name)
            joints.append(Joint(named, handle.id, handle.place.position, pivot, frame, image))
            of_column.append(number)
            mirrored.append(mirror ^ below)
    of, sides = np.array(of_column, int), np.array(mirrored, bool)
    posed = PosedShape(session.bound, (weights, columns))
    return Rig(session.mesh, edit, tuple(joints), origin, default, tuple(poses), posed, weights, of, sides)


def _one_for_each_pivot(weights: Float32, columns: Sequence[Column]) -> tuple[Float32, tuple[Column, ...]]:
    """Return the weights (V, C) with one column for all counterparts that share one pivot."""
    groups: dict[tuple[int, int], list[int]] = {}
    for number, column in enumerate(columns):
        groups.setdefault((column.handle, column.counterpart.vertex), []).append(number)
    if len(groups) == len(columns):
        return weights, tuple(columns)
    found = np.stack([weights[:, group].sum(axis=1) for group in groups.values()], axis=1)
    return found, tuple(columns[first] for first, *_ in groups.values())


def _widest(edits: Sequence[Edit], session: Deformer) -> list[Band]:
    """Return the blend bands (C,) of the columns of the first of `edits`, each as wide as the widest in all `edits`."""
    needed = zip(*(session.bound.bands(edits[0], edit) for edit in edits), strict=True)
    return [widest(each) for each in needed]


def _frame(transforms: Sequence[Transform]) -> Float64:
    """Return axes (3, 3), as columns: of the first transform with unequal scales; if none, of the first with axes."""
    uneven = [each for each in transforms if len(set(each.scale)) > 1]
    for each in (*uneven, *(each for each in transforms if not uneven)):
        if each.axes is not None or uneven:
            return np.eye(3) if each.axes is None else np.asarray(each.axes).T
    return np.eye(3)


def _carry(column: Column, handle: Handle) -> Float64:
    """Return the rigid map Φ (4, 4) from a handle to one of its counterparts."""
    carry, own = np.eye(4), column.counterpart
    carry[:3, :3] = own.frame
    carry[:3, 3] = np.asarray(own.position) - own.frame @ np.asarray(handle.place.position)
    return carry


def _side(plane: SymmetryPlane, points: Float64) -> Float64:
    """Return the weight (N,) of the plane's positive side at points (N, 3): a smoothstep across the plane's band."""
    height = plane.signed_distance(points)
    if plane.band == 0:
        return np.asarray(height >= 0, np.float64)
    t = np.clip(height / (2.0 * plane.band) + 0.5, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
