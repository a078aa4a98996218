"""Joints, which represent handles in other programs. The frame of a joint is its position and its three axes.

A rigid map Φ maps a handle to one of its counterparts. If the handle has the transform D, the counterpart has Φ D Φ⁻¹.
Φ also maps the frame of the handle's joint to the frame of the counterpart's joint. So all joints of a handle have the
same transform in their own frames. Frames must be right-handed, so the three axes are negated if Φ is a reflection.
The same rotation then acts mirrored, as animators expect of mirrored joints.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dfd.common.linear_algebra import Float64
from dfd.posing.transforms import Transform, Vector, rotation_matrix

# Off-diagonal entries of a scale matrix are rounding errors if they are below this fraction of the largest factor.
SHEAR = 1e-9


@dataclass(frozen=True)
class Local:
    """The transform of a joint in its own frame or relative to its parent: scale, then rotation, then translation."""

    translation: Float64  # (3,) mesh units
    rotation: Float64  # (4,) quaternion x, y, z, w
    scale: Float64  # (3,)

    @property
    def matrix(self) -> Float64:
        """Return the transform as a (4, 4) matrix."""
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(self.rotation).as_matrix() * self.scale
        matrix[:3, 3] = self.translation
        return matrix


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a rig. Each vertex follows the transform of the joint with a weight."""

    name: str  # unique in the rig
    handle: int | None  # id of its handle; None for the root joint and for the joint of the default transform D₀
    center: Vector  # (3,) position of the handle, mesh units; it is the pivot of transforms without a pivot
    pivot: Float64  # (3,) origin of the handle's frame, mesh units
    axes: Float64  # (3, 3) axes of the handle's frame, as columns
    carry: Float64  # (4, 4) the rigid map Φ from the handle to this joint; a reflection for a mirror image

    @property
    def frame(self) -> Float64:
        """Return the rigid map (4, 4), without reflection, from the frame of the joint at rest to mesh coordinates."""
        frame = np.eye(4)
        frame[:3, :3] = self.carry[:3, :3] @ self._basis
        frame[:3, 3] = self.carry[:3, :3] @ self.pivot + self.carry[:3, 3]
        return frame

    @property
    def _basis(self) -> Float64:
        """Return the axes (3, 3), negated if `carry` maps them to a left-handed frame."""
        return self.axes * np.sign(np.linalg.det(self.carry[:3, :3] @ self.axes))

    def local(self, transform: Transform) -> Local:
        """Return the joint's transform in its own frame, if the handle has the transform `transform`.

        Raises ValueError if `transform` scales along axes other than the joint's, because the result would be a shear.
        """
        basis = self._basis
        axes = np.eye(3) if transform.axes is None else np.asarray(transform.axes).T
        inside = basis.T @ axes
        stretch = inside * np.asarray(transform.scale) @ inside.T
        beside = stretch - np.diag(np.diag(stretch))
        if np.abs(beside).max() > SHEAR * np.abs(transform.scale).max():
            raise ValueError(
                f"`poses` must scale handle {self.handle} along the same axes throughout: joint axes are fixed"
            )
        turn = basis.T @ rotation_matrix(transform.rotation) @ basis
        moved = transform.matrix(self.center)
        shift = basis.T @ (moved[:, :3] @ self.pivot + moved[:, 3] - self.pivot)
        return Local(shift, Rotation.from_matrix(turn).as_quat(), np.diag(stretch).copy())

    def placed(self, local: Local) -> Local:
        """Convert `local` from the joint's frame to mesh coordinates, which are the frame of a parent at the origin."""
        frame = self.frame
        rotation = Rotation.from_matrix(frame[:3, :3]) * Rotation.from_quat(local.rotation)
        return Local(frame[:3, :3] @ local.translation + frame[:3, 3], rotation.as_quat(), local.scale)
