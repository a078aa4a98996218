"""Write the files that the user downloads: the posed mesh, rigs, weights, the edit and the field."""

import zipfile
from pathlib import Path
from typing import Literal

from dfd.common.files import file_stem
from dfd.editing.deformer import Deformer
from dfd.editing.edit_file import write_edit
from dfd.export.export_rig import export_rig
from dfd.export.export_weights import export_weights

Kind = Literal["glb", "obj", "ply", "stl", "rig", "morph", "weights", "animation", "edit", "field"]
ENDINGS = {  # endings of file names by kind; all other kinds are posed meshes, with endings such as "_edited.glb"
    "rig": "_rig.glb",
    "morph": "_morph.glb",
    "weights": "_weights.npz",
    "animation": "_poses.glb",
    "edit": "_edit.json",
    "field": ".field.safetensors",
}


def export(deformer: Deformer, kind: Kind, name: str, folder: Path) -> tuple[Path, str]:
    """Write a file of the format `kind` into `folder`. Return its path and a report, empty for most formats.

    `name` is the name of the shape.

    Raises ValueError if an animation has fewer than two poses or poses at equal times, or if a rig has no handle.
    Raises OSError if the file cannot be written.
    """
    path, report = folder / f"{file_stem(name)}{ENDINGS.get(kind, f'_edited.{kind}')}", ""
    if kind == "edit":
        write_edit(path, deformer.edit, deformer.mesh)  # without a field, the file has no paths of this machine
    elif kind == "field":
        deformer.field.save(path)
    elif kind == "animation":
        report = _animation(deformer, path)
    elif kind in ("rig", "morph"):
        report = str(export_rig(deformer, path, form="morph" if kind == "morph" else None, poses=()))
    elif kind == "weights":
        export_weights(deformer, path)
    else:
        path = _mesh(deformer, path)
    return path, report


def _animation(deformer: Deformer, path: Path) -> str:
    """Write an animated skin. If a part bends or a skin is impossible, write morph targets. Return the report."""
    poses = deformer.edit.poses
    if len(poses) < 2:
        raise ValueError("Store at least two poses on the timeline: the animation goes from one to the next")
    bends = any(each.bends for pose in poses for each in pose.transforms.values())
    try:
        return str(export_rig(deformer, path, form="morph" if bends else "skin"))
    except ValueError as skin_error:
        try:
            return str(export_rig(deformer, path, form="morph"))
        except ValueError:
            raise skin_error from None


def _mesh(deformer: Deformer, path: Path) -> Path:
    """Write the posed mesh, and return its path. If the format needs several files, write them into a ZIP file."""
    deformer.mesh.save(path, deformer.vertices)
    files = sorted(path.parent.iterdir())
    if len(files) == 1:
        return path
    packed = path.with_suffix(".zip")
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in files:
            archive.write(file, file.name)
    return packed
