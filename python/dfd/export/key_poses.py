"""Key poses for an animation: read them, check their times, and apply them."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.editing.edit import Edit
from dfd.editing.key_pose import KeyPose
from dfd.posing.transforms import Transform


def checked_poses(function: str, poses: Iterable[KeyPose], edit: Edit) -> tuple[KeyPose, ...]:
    """Return `poses` as a tuple.

    Raises ValueError if an item is not a key pose, is not later than the item before it, or has a handle not in `edit`.
    """
    try:
        checked = replace(edit, poses=tuple(poses)).poses
    except ArgumentError as error:
        raise ArgumentError(error.argument, error.reason, function) from None
    for before, pose in pairwise(checked):
        if np.float32(pose.seconds) <= np.float32(before.seconds):  # files store 32-bit floats
            found = f"got one at {pose.seconds:g} s after one at {before.seconds:g} s"
            raise ArgumentError("poses", f"must come one after the other in time, {found}", function)
    return checked


def posed_edit(edit: Edit, pose: KeyPose) -> Edit:
    """Return `edit` with the transforms of `pose`; all handles without a transform in `pose` are at rest."""
    handles = (replace(each, transform=pose.transforms.get(each.id, Transform())) for each in edit.handles)
    return replace(edit, handles=tuple(handles))
