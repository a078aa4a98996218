"""Files that a person takes along: the posed mesh from the C++ kernel, the edit, the field. Each is served once."""

from __future__ import annotations

import re
import secrets
import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dfd.app.protocol import parts
from dfd.editing.edit_file import write_edit
from dfd.posing.transforms import Transform

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["EXPORTS", "export", "file_stem"]

EXPORTS = "exports"  # the folder, inside that of the session
LONGEST_STEM = 80


def export(
    deformer: Deformer, kind: str, name: str, folder: Path, poses: Sequence[parts.KeyPose] = ()
) -> tuple[str, str]:
    """Write what `kind` says, a format of the protocol, and return its address, relative to the page, and name.

    `name` is the shape's, `folder` the session's, `poses` are those of the timeline.

    Raises
    ------
    ValueError
        If an animation is asked for and there are fewer than two poses, or two at one moment.
    OSError
        If it cannot be written.
    """
    number = secrets.token_hex(16)
    place = folder / EXPORTS / number
    place.mkdir(parents=True)
    stem = file_stem(name)
    try:
        if kind == "edit":
            path = place / f"{stem}_edit.json"
            write_edit(path, deformer.edit, deformer.mesh)  # without the places of files here, which are nobody else's
        elif kind == "field":
            path = place / f"{stem}.field.safetensors"
            deformer.field.save(path)
        elif kind == "animation":
            path = place / f"{stem}_poses.glb"
            _animation(deformer, path, poses)
        else:
            path = _mesh(deformer, place, f"{stem}_edited", kind)
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise
    return f"download/{folder.name}/{number}", path.name


def file_stem(name: str) -> str:
    """A file's name without its ending, made of what every system takes."""
    stem = re.sub(r"\.[A-Za-z0-9]{1,8}$", "", name)
    return re.sub(r"[^\w-]+", "_", stem)[:LONGEST_STEM].strip("_") or "mesh"


def _animation(deformer: Deformer, path: Path, poses: Sequence[parts.KeyPose]) -> None:
    """The shape on joints, or on morph targets where it is on joints of its own, moving from pose to pose."""
    from dfd.export.export_rig import export_rig
    from dfd.export.key_poses import KeyPose

    if len(poses) < 2:
        raise ValueError("Store at least two poses on the timeline: the animation goes from one to the next")
    present = {handle.id for handle in deformer.handles}
    moments = [
        KeyPose(
            pose.seconds,
            {
                each.handle: Transform(each.translation, each.rotation, each.scale, each.pivot, each.axes)
                for each in pose.transforms
                if each.handle in present
            },
            pose.name,
        )
        for pose in poses
    ]
    try:
        export_rig(deformer, path, form="skin", poses=moments)
    except ValueError as refused:
        try:
            export_rig(deformer, path, form="morph", poses=moments)
        except ValueError:
            raise refused from None


def _mesh(deformer: Deformer, place: Path, stem: str, kind: str) -> Path:
    """The posed mesh as one file: a zip where the format needs others beside it."""
    written = place / "files"
    written.mkdir()
    deformer.mesh.save(written / f"{stem}.{kind}", deformer.vertices)
    files = sorted(written.iterdir())
    path = place / (f"{stem}.{kind}" if len(files) == 1 else f"{stem}.zip")
    if len(files) == 1:
        files[0].rename(path)
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for file in files:
                archive.write(file, file.name)
    shutil.rmtree(written)
    return path
