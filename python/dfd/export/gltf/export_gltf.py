"""Write a rig as a glTF file, with a skin or with morph targets. Key poses become an animation."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.editing.key_pose import KeyPose
from dfd.export.gltf import morph, skin
from dfd.export.gltf.document import GltfDocument
from dfd.export.key_poses import slopes
from dfd.export.report import RigReport, report_of
from dfd.export.rig import Rig
from dfd.export.skinning import difference_of, skin_of
from dfd.mesh.file.gltf.header import Header

NAME = "dfd key poses"


def export_gltf(rig: Rig, target: Path, form: str, most: int | None) -> RigReport:
    """Write a rig to the file `target`, with `form` "skin" or "morph".

    In a skin, a vertex follows at most `most` joints; None sets no limit. Raises the errors of `export_rig`.
    """
    document = GltfDocument(rig.mesh)
    if form == "skin":
        left = ", ".join(skin.left_behind(document))
        found = skin_of(rig, most)
        joints = skin.add_skin(document, rig, found)
        channels = (
            (node, path, np.array([getattr(locals_[number], path) for locals_ in found.moments[1:]]))
            for number, node in enumerate(joints[1:], 1)  # the root joint never moves
            for path in ("translation", "rotation", "scale")
        )
        _animate(document, rig, channels)
        note = f"the file's own animations no longer move {left}; morph targets would keep these motions"
        notes = (note,) if left else ()
        report = report_of(rig, target, form, difference_of(rig, found.shown), skin=found, notes=notes)
    else:
        targets = morph.targets_of(rig)
        nodes = morph.add_targets(document, rig, targets)
        _animate(document, rig, ((node, "weights", targets.weights[1:].ravel()) for node in nodes))
        report = report_of(rig, target, form, difference_of(rig, targets.shown), targets=len(targets.names))
    document.write(target)
    return report


def _animate(document: GltfDocument, rig: Rig, channels: Iterable[tuple[int, str, NDArray[Any]]]) -> None:
    """Append an animation. A channel is a node, a property of this node, and the property's values at the key poses.

    If a pose eases, the animation is cubic: tangents are 0 there, and at other poses those of a linear motion.
    """
    if not rig.poses:
        return
    animation: Header = {"name": NAME, "channels": [], "samplers": []}
    times = document.accessor(np.array([pose.seconds for pose in rig.poses], "<f4"), bounds=True)
    eases = any(pose.ease for pose in rig.poses)
    interpolation = "CUBICSPLINE" if eases else "LINEAR"
    for number, (node, path, values) in enumerate(channels):
        if eases:
            values = _with_tangents(values, rig.poses)
        output = document.accessor(values.astype("<f4"))
        animation["samplers"].append({"input": times, "interpolation": interpolation, "output": output})
        animation["channels"].append({"sampler": number, "target": {"node": node, "path": path}})
    document.append("animations", animation)


def _with_tangents(values: NDArray[Any], poses: Sequence[KeyPose]) -> NDArray[Any]:
    """Return the tangent before each pose, its value, and the tangent after it, in the shape of rows of `values`.

    `values` are (P, N), or (P × N,) for weights of morph targets.
    """
    at = values.astype(np.float64).reshape(len(poses), -1)
    if values.ndim == 2 and values.shape[1] == 4:  # quaternions q and −q are the same rotation
        signs = np.where((at[1:] * at[:-1]).sum(axis=1) < 0, -1.0, 1.0)
        at[1:] *= np.cumprod(signs)[:, None]
    seconds = np.array([pose.seconds for pose in poses], np.float64)
    speed = np.diff(at, axis=0) / np.maximum(np.diff(seconds), 1e-9)[:, None]
    still, (start, end) = np.zeros((1, at.shape[1])), slopes(poses).T[:, :, None]
    before, after = np.concatenate([still, end * speed]), np.concatenate([start * speed, still])
    triples = np.stack([before, at, after], axis=1)
    return triples.reshape(-1, values.shape[1]) if values.ndim == 2 else triples.ravel()
