"""Export of a session to animation programs: a skin, morph targets or the moved shape, in glTF or USD."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dfd.common import check
from dfd.export.gltf.export_gltf import export_gltf
from dfd.export.gltf.skin import MOST_JOINTS
from dfd.export.key_poses import KeyPose, checked_poses
from dfd.export.report import RigReport, rig_report
from dfd.export.rig import Rig, rig_of

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["ENDINGS", "Form", "export_rig"]

Form = Literal["skin", "morph", "baked"]
GLTF = (".glb", ".gltf")
USD = (".usda", ".usdc", ".usdz")
PLAIN = (".obj", ".ply", ".stl", ".off")
ENDINGS = (*GLTF, *USD, *PLAIN)
PORTABLE_INFLUENCES = 4  # that every reader of glTF supports


def export_rig(
    session: Deformer,
    path: str | os.PathLike[str],
    *,
    form: Form = "skin",
    influences: int | str | None = None,
    poses: Sequence[KeyPose] = (),
) -> RigReport:
    """Write a session's shape and handles so that other programs can pose them.

    A mesh from a glTF file keeps the rest of that file, such as UVs, materials, textures and parts, in a glTF file.

    Parameters
    ----------
    session
        The shape with its handles. The file opens in the pose of the present edit.
    path
        A .glb or .gltf file; a .usda, .usdc or .usdz file, for which `pip install dfd[export]` is needed; with
        `form="baked"` an .obj, .ply, .stl or .off file as well.
    form
        "skin": a joint for each handle and each of its instances, in their own frames at their pivots, with the weights
        with which `dfd.pose` blends (Eq. 1 and 8), and a root that never moves for what they leave of 1 (or another
        joint for D₀, where the edit has one). "morph": a target for each handle that moves, or for each key pose.
        "baked": the posed shape as a static mesh.
    influences
        How many joints a vertex follows at most, those with the largest weights, which are divided by their sum: by
        default 4 in glTF, which every reader supports. "all", the default in USD, prunes none; glTF stores more than 4
        in further sets, which few readers support.
    poses
        Key poses, ordered by time, that become an animation, linear between poses.

    Returns
    -------
    report
        What was written, with the largest and the mean distance from the result of `dfd.pose`. Where nothing is pruned
        and no weights sum to more than 1, a linear blend differs only by the rounding of 32-bit floats.

    Raises
    ------
    ValueError
        If the ending is another or does not go with `form`, the mesh has a skin (for "skin") or morph targets (for
        "morph"), nothing is held, there are more than 65,535 joints, one of them cannot be inverted, or a key pose is
        of other handles, not after the one before it, or scales along other axes.
    OSError
        If a file cannot be written; what was there before stays.
    """
    target = Path(path)
    ending = target.suffix.lower()
    check.choice("export_rig", "form", form, Form)
    if ending not in ENDINGS:
        raise ValueError(f"export_rig: `path` must end in {', '.join(ENDINGS)}, got {target}")
    if form != "baked" and ending in PLAIN:
        raise ValueError(f"export_rig: `path` must end in {', '.join((*GLTF, *USD))} for {form!r}, got {target}")
    most = _most(influences, ending)
    moments = checked_poses("export_rig", poses, session.edit)
    if form == "baked" and moments:
        raise ValueError("export_rig: `poses` must be left out for 'baked', which does not move")
    rig = rig_of(session, moments)
    if form == "skin":
        _check_joints(rig)
    if ending in USD:
        from dfd.export.usd.export_usd import export_usd

        return export_usd(rig, target, form, most)
    if form == "baked":
        session.mesh.save(target, session.vertices)
        return rig_report(rig, (target,), form)
    return export_gltf(rig, target, form, most)


def _most(influences: int | str | None, ending: str) -> int | None:
    """How many influences a vertex may have, None for all."""
    if influences is None:
        return PORTABLE_INFLUENCES if ending in GLTF else None
    if isinstance(influences, str):
        if influences != "all":
            raise ValueError(f"export_rig: `influences` must be a whole number or 'all', got {influences!r}")
        return None
    return check.whole("export_rig", "influences", influences, minimum=1)


def _check_joints(rig: Rig) -> None:
    if len(rig.joints) == rig.default + 1:
        raise ValueError("export_rig: `session` must have a handle, got none: there would be no joint to pose")
    if len(rig.joints) > MOST_JOINTS:
        raise ValueError(
            f"export_rig: `session` must have at most {MOST_JOINTS} joints, the root's among them, got "
            f"{len(rig.joints)}"
        )
