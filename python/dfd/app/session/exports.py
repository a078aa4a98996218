"""Files for download: the posed mesh from the C++ kernel, the edit, the field. Each is served once."""

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

EXPORTS = "exports"  # the folder, inside that of the session
LONGEST_STEM = 80


def export(
    deformer: Deformer, kind: str, name: str, folder: Path, poses: Sequence[parts.KeyPose] = ()
) -> tuple[str, str]:
    """Write a file of the format `kind` (see the protocol); return its URL, relative to the page, and its name.

    `name` is the shape's, `folder` the session's, `poses` are those of the timeline.

    Raises ValueError if an animation is requested with fewer than two poses, or with two at the same time. Raises
    OSError if it cannot be written.
    """
    number = secrets.token_hex(16)
    directory = folder / EXPORTS / number
    directory.mkdir(parents=True)
    stem = file_stem(name)
    try:
        if kind == "edit":
            path = directory / f"{stem}_edit.json"
            write_edit(path, deformer.edit, deformer.mesh)  # without paths of this machine
        elif kind == "field":
            path = directory / f"{stem}.field.safetensors"
            deformer.field.save(path)
        elif kind == "animation":
            path = directory / f"{stem}_poses.glb"
            _animation(deformer, path, poses)
        else:
            path = _mesh(deformer, directory, f"{stem}_edited", kind)
    except BaseException:
        shutil.rmtree(directory, ignore_errors=True)
        raise
    return f"download/{folder.name}/{number}", path.name


def file_stem(name: str) -> str:
    """A file's name without its ending, of characters that every file system accepts."""
    stem = re.sub(r"\.[A-Za-z0-9]{1,8}$", "", name)
    return re.sub(r"[^\w-]+", "_", stem)[:LONGEST_STEM].strip("_") or "mesh"


def _animation(deformer: Deformer, path: Path, poses: Sequence[parts.KeyPose]) -> None:
    """An animation through the poses: a skin, or morph targets if the mesh has a skin already."""
    from dfd.export.export_rig import export_rig
    from dfd.export.key_poses import KeyPose

    if len(poses) < 2:
        raise ValueError("Store at least two poses on the timeline: the animation goes from one to the next")
    existing = {handle.id for handle in deformer.handles}
    key_poses = [
        KeyPose(
            pose.seconds,
            {
                each.handle: Transform(each.translation, each.rotation, each.scale, each.pivot, each.axes)
                for each in pose.transforms
                if each.handle in existing
            },
            pose.name,
        )
        for pose in poses
    ]
    try:
        export_rig(deformer, path, form="skin", poses=key_poses)
    except ValueError as skin_error:
        try:
            export_rig(deformer, path, form="morph", poses=key_poses)
        except ValueError:
            raise skin_error from None


def _mesh(deformer: Deformer, directory: Path, stem: str, kind: str) -> Path:
    """The posed mesh as one file: a zip if the format needs several."""
    written = directory / "files"
    written.mkdir()
    deformer.mesh.save(written / f"{stem}.{kind}", deformer.vertices)
    files = sorted(written.iterdir())
    path = directory / (f"{stem}.{kind}" if len(files) == 1 else f"{stem}.zip")
    if len(files) == 1:
        files[0].rename(path)
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for file in files:
                archive.write(file, file.name)
    shutil.rmtree(written)
    return path
