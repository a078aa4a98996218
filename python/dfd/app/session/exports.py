"""Files for download: the posed mesh from the C++ kernel, rigs, weights, the edit, the field. Each is served once."""

from __future__ import annotations

import re
import secrets
import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dfd.app.options import UPLOADS, Source
from dfd.app.protocol import parts
from dfd.editing.edit_file import write_edit
from dfd.posing.transforms import Transform

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

Kind = Literal["glb", "obj", "ply", "stl", "rig", "morph", "weights", "animation", "edit", "field", "files"]
EXPORTS = "exports"  # the folder, inside that of the session
LONGEST_STEM = 80


def export(
    deformer: Deformer,
    kind: Kind,
    name: str,
    folder: Path,
    poses: Sequence[parts.KeyPose] = (),
    source: Source | None = None,
) -> tuple[str, str, str]:
    """Write a file of the format `kind` (see the protocol); return its URL, relative to the page, and its name.

    The third is what is to be said of a rig: how it differs from what is seen.

    `name` is the shape's, which came from `source`, `folder` the session's, `poses` are those of the timeline.

    Raises ValueError if an animation is requested with fewer than two poses, or with two at the same time, or nothing
    is held for a rig to be made of. Raises OSError if it cannot be written.
    """
    number = secrets.token_hex(16)
    directory = folder / EXPORTS / number
    directory.mkdir(parents=True)
    stem, said = file_stem(name), ""
    try:
        if kind == "edit":
            path = _edit(deformer, directory, stem)
        elif kind == "field":
            path = _field(deformer, directory, stem)
        elif kind == "animation":
            path = directory / f"{stem}_poses.glb"
            said = _animation(deformer, path, poses)
        elif kind in ("rig", "morph"):
            from dfd.export.export_rig import export_rig

            path = directory / f"{stem}_{kind}.glb"
            said = str(export_rig(deformer, path, form="morph" if kind == "morph" else None))
        elif kind == "weights":
            from dfd.export.export_weights import export_weights

            path = directory / f"{stem}_weights.npz"
            export_weights(deformer, path)
        elif kind == "files":
            path = directory / f"{stem}_files.zip"
            _files(deformer, path, name, source)
        else:
            path = _mesh(deformer, directory, f"{stem}_edited", kind)
    except BaseException:
        shutil.rmtree(directory, ignore_errors=True)
        raise
    return f"download/{folder.name}/{number}", path.name, said


def _edit(deformer: Deformer, directory: Path, stem: str) -> Path:
    path = directory / f"{stem}_edit.json"
    write_edit(path, deformer.edit, deformer.mesh)  # without paths of this machine
    return path


def _field(deformer: Deformer, directory: Path, stem: str) -> Path:
    path = directory / f"{stem}.field.safetensors"
    deformer.field.save(path)
    return path


def _files(deformer: Deformer, path: Path, name: str, source: Source | None) -> None:
    """A ZIP of the mesh, with what was uploaded beside it, its field and the edit, under the names that scripts use."""
    written = path.parent / "files"
    written.mkdir()
    opened = source.path if source is not None else None
    if opened is None:
        deformer.mesh.save(written / mesh_file(name))
    else:
        beside = sorted(opened.parent.iterdir()) if UPLOADS in opened.parts else [opened]
        for file in beside:
            if file.is_file():
                shutil.copy(file, written / (mesh_file(name) if file == opened else file.name))
    _edit(deformer, written, file_stem(name))
    _field(deformer, written, file_stem(name))
    _zip(written, path)


def mesh_file(name: str) -> str:
    """The name under which scripts read the shape: its own, or that of a GLB file where it has none."""
    return name if "." in name else f"{file_stem(name)}.glb"


def file_stem(name: str) -> str:
    """A file's name without its ending, of characters that every file system accepts."""
    stem = re.sub(r"\.[A-Za-z0-9]{1,8}$", "", name)
    return re.sub(r"[^\w-]+", "_", stem)[:LONGEST_STEM].strip("_") or "mesh"


def _animation(deformer: Deformer, path: Path, poses: Sequence[parts.KeyPose]) -> str:
    """An animation through the poses: a skin, or morph targets if something bends or the mesh has a skin already."""
    from dfd.export.export_rig import export_rig
    from dfd.export.key_poses import KeyPose

    if len(poses) < 2:
        raise ValueError("Store at least two poses on the timeline: the animation goes from one to the next")
    existing = {handle.id for handle in deformer.handles}
    key_poses = [
        KeyPose(
            pose.seconds,
            {
                each.handle: Transform(**each.model_dump(exclude={"handle"}))
                for each in pose.transforms
                if each.handle in existing
            },
            pose.name,
        )
        for pose in poses
    ]
    bends = any(each.bends for pose in key_poses for each in pose.transforms.values())
    try:
        return str(export_rig(deformer, path, form="morph" if bends else "skin", poses=key_poses))
    except ValueError as skin_error:
        try:
            return str(export_rig(deformer, path, form="morph", poses=key_poses))
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
        written.rmdir()
    else:
        _zip(written, path)
    return path


def _zip(folder: Path, path: Path) -> None:
    """Write the files of a folder as one, in place of the folder."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in sorted(folder.iterdir()):
            archive.write(file, file.name)
    shutil.rmtree(folder)
