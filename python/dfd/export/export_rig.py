"""Exports a session to animation programs as a skin, morph targets or the posed shape, in glTF."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.editing.deformer import Deformer
from dfd.export.gltf.export_gltf import export_gltf
from dfd.export.gltf.skin import MOST_JOINTS, parts_with_deformers
from dfd.export.key_poses import KeyPose, checked_poses
from dfd.export.report import RigReport, report_of
from dfd.export.rig import rig_of
from dfd.export.skinning import Difference
from dfd.mesh.file.write import write
from dfd.mesh.mesh import Mesh

Form = Literal["skin", "morph", "baked"]
GLTF = (".glb", ".gltf")
PLAIN = (".obj", ".ply", ".stl", ".off")
ENDINGS = (*GLTF, *PLAIN)
WRITTEN = {"morph": "written as morph targets", "baked": "baked"}
PORTABLE_INFLUENCES = 4  # influences per vertex that every reader of glTF supports


def export_rig(
    session: Deformer,
    path: str | os.PathLike[str],
    *,
    form: Form | None = None,
    influences: int | str | None = None,
    poses: Sequence[KeyPose] = (),
) -> RigReport:
    """Write a session's shape and handles so that other programs can pose them.

    If the mesh comes from a glTF file, a glTF file keeps the rest of it, such as UVs, materials, textures and parts.

    Parameters
    ----------
    session
        The shape with its handles. The file opens in the pose of the present edit.
    path
        A .glb or .gltf file; with `form="baked"` an .obj, .ply, .stl or .off file as well.
    form
        "skin": a joint for each handle and each counterpart, in their own frames at their pivots. The weights are those
        with which `dfd.pose` blends (Eq. 1 and 8). A root that never moves gets what they leave of 1. If the edit has
        D₀, another joint gets that rest instead. "morph": a target for each handle that moves, or for each key pose.
        "baked": the posed shape as a static mesh. The default is the first form that fits beside the mesh's own skin
        and morph targets, which a glTF file keeps.
    influences
        The largest number of joints that a vertex follows: by default 4, which every reader supports. The largest
        weights stay and are divided by their sum. "all" prunes none; more than 4 are stored in further sets, which few
        readers support.
    poses
        Key poses, ordered by time. They become an animation that is linear between poses.

    Returns
    -------
    report
        What was written, with the largest and the mean distance from the result of `dfd.pose`. Where nothing is pruned
        and no weights sum to more than 1, a linear blend differs only by the rounding of 32-bit floats.

    Raises ValueError if the file ending is not supported or does not fit `form`. Raises ValueError if the mesh keeps a
    skin (for "skin") or morph targets (for "morph"), or the session has no handle. Raises ValueError if there are more
    than 65,535 joints, or one of them cannot be inverted. Raises ValueError if a key pose is of other handles, not
    after the one before it, or scales along other axes. Raises OSError if a file cannot be written; an existing file
    stays unchanged.
    """
    target = Path(path)
    check.ending("export_rig", "path", target, ENDINGS)
    form, note = form_for(session.mesh, target, form)
    most = _most(influences)
    moments = checked_poses("export_rig", poses, session.edit)
    if form == "baked" and moments:
        raise ArgumentError("poses", "must be left out for 'baked', which does not move", "export_rig")
    rig = rig_of(session, moments)
    joints = len(rig.joints) if form == "skin" else None
    if joints == rig.default + 1:
        raise ArgumentError("session", "must have a handle, got none: there would be no joint to pose", "export_rig")
    if joints is not None and joints > MOST_JOINTS:
        why = f"must have at most {MOST_JOINTS} joints with the root's, got {joints}"
        raise ArgumentError("session", why, "export_rig")
    if form == "baked":
        mesh = session.mesh
        lost = write(target, session.vertices, mesh.faces, mesh.appearance, mesh.scene)
        difference = Difference(float(lost.max(initial=0.0)), float(lost.mean()) if len(lost) else 0.0)
        report = report_of(rig, target, form, difference)
    else:
        report = export_gltf(rig, target, form, most)
    return replace(report, notes=(*report.notes, *note))


def form_for(mesh: Mesh, path: Path, form: Form | None) -> tuple[Form, tuple[str, ...]]:
    """Return the form in which a session of `mesh` fits into `path`, and a note if that form is not "skin".

    Raises ValueError if `form` is not known, or does not fit beside the content of the mesh's own file.
    """
    ending = path.suffix.lower()
    if form is not None:
        check.choice("export_rig", "form", form, Form)
    if form in ("skin", "morph") and ending in PLAIN:
        endings = ", ".join(GLTF)
        raise ArgumentError("path", f"must end in {endings} for {form!r}, got {path}", "export_rig")
    if ending in PLAIN:
        return "baked", ()
    skinned, morphed = parts_with_deformers(mesh) if ending in GLTF else (None, None)
    if form is None:
        if skinned is None:
            return "skin", ()
        possible: Form = "morph" if morphed is None else "baked"
        return possible, (f"part {skinned!r} keeps its own skin, so the edit is {WRITTEN[possible]}",)
    own = {"skin": (skinned, "'morph'", "a skin"), "morph": (morphed, "'skin'", "morph targets")}
    kept, other, what = own.get(form, (None, "", ""))
    if kept is not None:
        why = f"must be {other} or 'baked' for a mesh with {what}: part {kept!r} has its own"
        raise ArgumentError("form", why, "export_rig")
    return form, ()


def _most(influences: int | str | None) -> int | None:
    """Return the largest number of influences of a vertex, None for all."""
    if influences is None:
        return PORTABLE_INFLUENCES
    if isinstance(influences, str):
        if influences != "all":
            raise ArgumentError("influences", f"must be a whole number or 'all', got {influences!r}", "export_rig")
        return None
    return check.whole("export_rig", "influences", influences, minimum=1)
