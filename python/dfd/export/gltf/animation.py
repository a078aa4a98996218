"""Key poses as an animation, of joints or of the weights of morph targets, linear from one to the next.

As in the app, positions and scales are interpolated linearly and rotations spherically.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.export.gltf.document import GltfDocument
from dfd.export.joints import Local
from dfd.export.key_poses import KeyPose
from dfd.mesh.file.gltf.header import Header

NAME = "dfd key poses"


def add_joint_animation(
    document: GltfDocument, joints: Sequence[int], poses: Sequence[KeyPose], moments: Sequence[Sequence[Local]]
) -> None:
    """Append an animation of the nodes `joints`, whose first is the root and rests.

    `moments` has the locals (J) of each pose.
    """
    animation: Header = {"name": NAME, "channels": [], "samplers": []}
    times = _times(document, poses)
    for number, node in enumerate(joints[1:], 1):
        for path in ("translation", "rotation", "scale"):
            values = np.array([getattr(locals_[number], path) for locals_ in moments], "<f4")
            _add(document, animation, {"node": node, "path": path}, times, values)
    document.append("animations", animation)


def add_weight_animation(
    document: GltfDocument, nodes: Sequence[int], poses: Sequence[KeyPose], weights: Float64
) -> None:
    """Append an animation of the morph targets of `nodes`, with weights (poses, targets)."""
    animation: Header = {"name": NAME, "channels": [], "samplers": []}
    times = _times(document, poses)
    for node in nodes:
        _add(document, animation, {"node": node, "path": "weights"}, times, weights.astype("<f4").ravel())
    document.append("animations", animation)


def _times(document: GltfDocument, poses: Sequence[KeyPose]) -> int:
    return document.accessor(np.array([pose.seconds for pose in poses], "<f4"), bounds=True)


def _add(document: GltfDocument, animation: Header, target: Header, times: int, values: Float32) -> None:
    sampler = {"input": times, "interpolation": "LINEAR", "output": document.accessor(values)}
    animation["samplers"].append(sampler)
    animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})
