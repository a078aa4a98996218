"""Export an editing session to other programs, as a skin or morph targets in glTF, or as the posed shape."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.editing.deformer import Deformer
from dfd.editing.key_pose import KeyPose
from dfd.export.gltf.export_gltf import export_gltf
from dfd.export.gltf.skin import MOST_JOINTS, parts_with_deformers
from dfd.export.key_poses import checked_poses
from dfd.export.report import RigReport, report_of
from dfd.export.rig import rig_of
from dfd.export.skinning import Difference
from dfd.mesh.file.write import write
from dfd.mesh.mesh import Mesh

Form = Literal["skin", "morph", "baked"]
GLTF = (".glb", ".gltf")
PLAIN = (".obj", ".ply", ".stl", ".off")
ENDINGS = (*GLTF, *PLAIN)
WRITTEN = {"morph": "written as morph targets", "baked": "baked"}  # how a report names the form that replaces a skin
PORTABLE_INFLUENCES = 4  # influences per vertex that every reader of glTF supports


def export_rig(
    session: Deformer,
    path: str | os.PathLike[str],
    *,
    form: Form | None = None,
    influences: int | str | None = None,
    poses: Sequence[KeyPose] | None = None,
) -> RigReport:
    """Write a session's shape and handles so that other programs can pose them.

    A new glTF file keeps UVs, materials, parts and other content of the glTF file from which the mesh was read.

    Raises ValueError if the file ending is not supported or does not fit `form`. Raises ValueError for "skin" if there
    is no handle, the mesh has its own skin, there are more than 65,535 joints, or a joint's matrix cannot be inverted.
    Raises ValueError for "morph" if the mesh has its own morph targets, or nothing moves and there are no poses. Raises
    ValueError if a key pose has an unknown handle, is not later than the pose before it, or scales along axes other
    than those of a joint. Raises OSError if a file cannot be written; an existing file stays unchanged.

    Parameters
    ----------
    session
        The shape with its handles. The file shows the pose of the present edit.
    path
        A .glb or .gltf file. With the form "baked", it can also be an .obj, .ply, .stl or .off file.
    form
        "skin" writes a joint for each counterpart of each handle. The weights of joints are those with which `dfd.pose`
        blends (Eq. 1 and 8). A root joint, which never moves, gets 1 minus the sum of these weights. If the edit has a
        default transform D₀, the joint of D₀ gets this weight instead. "morph" writes a morph target for each handle
        that moves or, with `poses`, one for the edit and one for each key pose. "baked" writes the posed shape as a
        static mesh. In a glTF file, the default is "skin". If the mesh already has a skin, the file keeps it, and the
        default is "morph". If the mesh also has morph targets, the default is "baked".
    influences
        The largest number of joints that a vertex follows, by default 4, which all programs can read. The largest
        weights of a vertex are kept and divided by their sum. "all" keeps all weights. Weights after the fourth are
        stored in further vertex attributes, which few programs can read.
    poses
        Key poses, ordered by time. They become an animation: cubic if a pose eases, or else linear. By default, they
        are those of the edit, which the form "baked" leaves out. An empty list writes no animation.

    Returns
    -------
    report
        The contents of the file, and the largest and mean distance of its vertices from the result of `dfd.pose`.

    Examples
    --------
    >>> import dfd
    >>> mesh = dfd.samples.chair().mesh
    >>> session = dfd.Deformer(mesh, dfd.distill(mesh))
    >>> foot = session.add("0.225,0,0.235", translation=(0, -0.2, 0))
    >>> report = dfd.export_rig(session, "chair_rigged.glb")
    """
    check.ending("export_rig", "path", path, ENDINGS)
    target = Path(path)
    form, note = form_for(session.mesh, target, form)
    most = _most(influences)
    own = () if form == "baked" else session.edit.poses
    moments = checked_poses("export_rig", own if poses is None else poses, session.edit)
    if form == "baked" and moments:
        raise ArgumentError("poses", "must be left out for 'baked', which does not move", "export_rig")
    rig = rig_of(session, moments)
    joints = len(rig.joints) if form == "skin" else None
    if joints == rig.default + 1:
        raise ArgumentError("session", "must have a handle, got none: there would be no joint to pose", "export_rig")
    if joints is not None and joints > MOST_JOINTS:
        why = f"must have at most {MOST_JOINTS} joints, including the root joint, got {joints}"
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
    """Return the form in which a session of `mesh` is written to `path`, and a note if the mesh's skin excludes "skin".

    Raises ValueError if `form` is unknown, does not fit the file ending, or would replace a skin or morph targets.
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
    """Return the largest number of influences of a vertex; None means that there is no limit."""
    if influences is None:
        return PORTABLE_INFLUENCES
    if isinstance(influences, str):
        if influences != "all":
            raise ArgumentError("influences", f"must be a whole number or 'all', got {influences!r}", "export_rig")
        return None
    return check.whole("export_rig", "influences", influences, minimum=1)
