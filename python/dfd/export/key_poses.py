"""Key poses for an animation: check their times, add poses between them, and apply them.

Between two key poses, the timeline of the app interpolates the values of transforms: translations, rotation vectors,
scales, bends and twists. So a key of 270° turns a part by 270°. A file interpolates quaternions along the shorter arc,
or displacements. Where a handle turns or bends by more than `STEP`, files have further poses, so both agree.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64
from dfd.editing.edit import Edit
from dfd.editing.key_pose import KeyPose
from dfd.posing.transforms import Transform

# Largest angle, in degrees, by which a handle turns or bends between two poses of a file. With a linear animation, a
# viewer then differs from the timeline by less than 3°, and not at all if the axis does not change.
STEP = 60.0
MOST_STEPS = 360  # largest number of steps between two key poses, which limits the size of a file


@dataclass(frozen=True)
class Step(KeyPose):
    """A pose between two key poses."""

    time: float = 0.0  # its time, as a fraction of the time between the two key poses
    share: float = 0.0  # the share of the motion that is done
    slope: float = 1.0  # derivative of the share with respect to the time

    __hash__ = KeyPose.__hash__


def checked_poses(function: str, poses: Iterable[KeyPose], edit: Edit) -> tuple[KeyPose, ...]:
    """Return `poses`, with further poses between two of them if a handle turns or bends by more than `STEP` degrees.

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
    return tuple(with_steps(checked))


def with_steps(poses: Sequence[KeyPose]) -> Iterator[KeyPose]:
    """Yield `poses`, ordered by time, and the poses between them."""
    for key, (before, pose) in enumerate(pairwise(poses), 2):
        yield before
        rest, last, end = Transform(), *(np.float32(each.seconds) for each in (before, pose))
        ends = {
            handle: (before.transforms.get(handle, rest), pose.transforms.get(handle, rest))
            for handle in {**before.transforms, **pose.transforms}
        }
        turned = max((_angle(*both) for both in ends.values()), default=0.0)
        count = min(int(np.ceil(turned / STEP - 1e-9)), MOST_STEPS)
        for number in range(1, count):
            time = number / count
            share, slope = _eased(time, before.ease, pose.ease)
            moment = {handle: between(*both, share) for handle, both in ends.items()}
            seconds = before.seconds + time * (pose.seconds - before.seconds)
            name = f"{pose.name or f'key pose {key}'}, {number} of {count}"
            if last < np.float32(seconds) < end:  # poses can be too near for 32-bit floats
                last = np.float32(seconds)
                yield Step(seconds, moment, name, time=time, share=share, slope=slope)
    yield from poses[-1:]


def slopes(poses: Sequence[KeyPose]) -> Float64:
    """Return the speeds (P − 1, 2) after each pose and before the next one, as multiples of the mean speed between."""

    def told(pose: KeyPose, edge: int) -> tuple[float, float, float]:
        return (pose.time, pose.share, pose.slope) if isinstance(pose, Step) else (edge, edge, not pose.ease)

    ends = np.array([[told(before, 0), told(pose, 1)] for before, pose in pairwise(poses)], np.float64).reshape(
        -1, 2, 3
    )
    times, shares = ends[:, 1, :2].T - ends[:, 0, :2].T
    return np.asarray(ends[:, :, 2] * (times / shares)[:, None])


def _angle(one: Transform, other: Transform) -> float:
    """Return the largest change of a rotation, a bend or a twist, in degrees."""
    changes = (np.subtract(getattr(one, name), getattr(other, name)) for name in ("rotation", "bend", "twist"))
    return float(max(np.linalg.norm(change) for change in changes))


def _eased(time: float, start: bool, end: bool) -> tuple[float, float]:
    """Return the share of a motion at the share `time` of its time, and its slope: 0 at both ends that ease, else 1."""
    a, b = not start, not end
    share = time * time * (3 - 2 * time) + a * time * (1 - time) ** 2 - b * time * time * (1 - time)
    slope = 6 * time * (1 - time) + a * (1 - time) * (1 - 3 * time) + b * time * (3 * time - 2)
    return share, slope


def between(one: Transform, other: Transform, share: float) -> Transform:
    """Return the transform at a `share` of the motion from `one` to `other`, as the timeline of the app shows it.

    A pose takes a missing pivot or axes, and without a bend also the joint, from the other one.
    """
    mixed: dict[str, Any] = {
        name: (1 - share) * np.asarray(getattr(one, name)) + share * np.asarray(getattr(other, name))
        for name in ("translation", "rotation", "scale", "bend", "twist")
    }
    if (start := one.pivot or other.pivot) and (end := other.pivot or one.pivot):
        mixed["pivot"] = (1 - share) * np.asarray(start) + share * np.asarray(end)
    axes, joint = other.axes or one.axes, (other if other.bends else one).joint
    return Transform(**mixed, pivot_at=(other if other.pivot else one).pivot_at, axes=axes, joint=joint)


def posed_edit(edit: Edit, pose: KeyPose) -> Edit:
    """Return `edit` with the transforms of `pose`; all handles without a transform in `pose` are at rest."""
    handles = (replace(each, transform=pose.transforms.get(each.id, Transform())) for each in edit.handles)
    return replace(edit, handles=tuple(handles))
