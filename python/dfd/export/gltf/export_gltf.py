"""A rig as a glTF file: with a skin, or with morph targets."""

from __future__ import annotations

from pathlib import Path

from dfd.export.gltf import animation, morph, skin
from dfd.export.gltf.document import GltfDocument
from dfd.export.report import RigReport, rig_report
from dfd.export.rig import Rig
from dfd.export.skinning import skin_of


def export_gltf(rig: Rig, target: Path, form: str, most: int | None) -> RigReport:
    """Write a rig as a "skin" of at most `most` influences a vertex, or as "morph" targets.

    Raises what `export_rig` raises.
    """
    document = GltfDocument(rig.mesh)
    report = _skin(document, rig, target, most) if form == "skin" else _morph(document, rig, target)
    document.write(target)
    return report


def _skin(document: GltfDocument, rig: Rig, target: Path, most: int | None) -> RigReport:
    left = skin.left_behind(document)
    found = skin_of(rig, most)
    joints = skin.add_joints(document, rig, found.moments[0])
    skin.add_skin(document, rig, found.influences, found.binds, joints)
    if rig.poses:
        animation.add_joint_animation(document, joints, rig.poses, found.moments[1:])
    note = f"the file's own animations no longer move {', '.join(left)}; morph targets would leave them theirs"
    return rig_report(rig, (target,), "skin", found.difference, found.influences, notes=[note] if left else ())


def _morph(document: GltfDocument, rig: Rig, target: Path) -> RigReport:
    targets = morph.targets_of(rig)
    nodes = morph.add_targets(document, rig, targets)
    if rig.poses:
        animation.add_weight_animation(document, nodes, rig.poses, targets.weights[1:])
    return rig_report(rig, (target,), "morph", targets.difference(rig), targets=len(targets.names))
