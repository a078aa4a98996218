"""Rewrite vertex positions and normals in the text of an OBJ file, with everything else unchanged.

In most files, only the coordinates in `v` and `vn` lines change. If face corners can no longer share a normal, `vn`
lines are added, and the normal indices of faces change. If the materials are copied, `mtllib` lines also change.
"""

from pathlib import PurePosixPath

import numpy as np

from dfd.common.linear_algebra import Float64, Int32
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.edits import Edits, rows_as_text
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.obj.read import picture_name, used_materials
from dfd.mesh.file.obj.text import ObjText, parse
from dfd.mesh.file.obj.write import Companions
from dfd.mesh.file.text import decoded
from dfd.mesh.images import image_format
from dfd.mesh.weld import weld

_PICTURES = (".bmp", ".gif", ".jpeg", ".jpg", ".png", ".tga", ".tif", ".tiff", ".webp")


def rewrite(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return the contents of files by name: the OBJ file with moved vertices, and its materials.

    Only vertices that have moved get new text. Materials are copied only if the file is written to another folder.
    """
    scene, target, corner_rows = saving.file, saving.target, saving.source.corner_rows
    assert scene.path is not None
    assert corner_rows is not None
    data = saving.source.data.tobytes()
    text = parse(data)
    changed = (saving.vertices != scene.vertices).any(axis=1)
    edits = Edits(data)
    scales = 1.0 if text.scales is None else text.scales[changed, None]
    edits.replace(text.position_spans[changed], rows_as_text(saving.vertices[changed] * scales))
    if changed.any():
        _edit_normals(edits, text, corner_rows, saving.of_rows())
    companions = Companions(target)
    if target.parent.resolve() != scene.path.parent.resolve():
        _rename_libraries(
            edits, text, *_copied_materials(text, AssetFolder(scene.path, saving.source.root), companions)
        )
    return {target.name: edits.result(), **companions.files}, np.zeros(0)


def _copied_materials(text: ObjText, assets: AssetFolder, companions: Companions) -> tuple[bytes | None, set[bytes]]:
    """Copy the materials that an OBJ file uses, and their textures, from `assets` to `companions`.

    Only textures that are valid images are copied. Return the name of the new MTL file, which is None if the OBJ file
    uses no material. Also return the names of all MTL files that could be read.
    """
    materials, read = used_materials(text, assets)
    if not materials:
        return None, read
    copied: list[bytes] = []
    for name, lines in materials.items():
        copied += [b"newmtl " + name, *(_with_copied_picture(line, assets, companions) for line in lines), b""]
    return companions.add_library(b"".join(line + b"\n" for line in copied)).encode(), read


def _with_copied_picture(line: bytes, assets: AssetFolder, companions: Companions) -> bytes:
    name = picture_name(line)
    if not name:
        return line
    try:
        data = assets.read(decoded(name))
        kind = image_format(data)
    except (ValueError, OSError):  # the reference stays
        return line
    path = PurePosixPath(decoded(name).replace("\\", "/"))
    plain = path.name if path.suffix.lower() in _PICTURES else f"{path.stem}.{kind}"
    added = companions.add(plain, data).encode()
    return line[: len(line) - len(name)] + added if line.endswith(name) else line.replace(name, added)


def _rename_libraries(edits: Edits, text: ObjText, name: bytes | None, read: set[bytes]) -> None:
    """In `mtllib` lines, replace all MTL files in `read` by the MTL file `name`, or remove them if `name` is None."""
    ends = np.flatnonzero(np.frombuffer(text.data + b"\n", np.uint8) == ord("\n"))
    for line, keyword, rest in text.statements:
        named = [rest] if rest in read else rest.split()
        if keyword == "mtllib" and read.intersection(named):
            left = [each for each in named if each not in read]
            start, end = int(ends[line - 1]) + 1 if line else 0, int(ends[line])
            end -= text.data[start:end].endswith(b"\r")
            names = [each for each in [name, *left] if each]
            if names != named:
                edits.replace([(start, end)], [text.line_break.join(b"mtllib " + each for each in names)])
            name = None


def _edit_normals(edits: Edits, text: ObjText, corner_rows: Int32, normals: Float64) -> None:
    """Rewrite the normals, and add `vn` lines if face corners can no longer share a line."""
    corners = np.flatnonzero((text.corners[:, 2] >= 0) & (corner_rows >= 0))
    corners = corners[~np.isnan(normals[corner_rows[corners]]).any(axis=1)]
    if not len(corners):
        return
    own = normals[corner_rows[corners]]
    number = text.corners[corners, 2]
    distinct, value = weld(own)
    pairs, first, pair = np.unique(number * (len(distinct) + 1) + value, return_index=True, return_inverse=True)
    # Face corners that share a `vn` line can get different normals. One normal replaces the line; others are added.
    keeps = np.diff(number[first], prepend=-1) > 0
    directions = own[first]
    moved = keeps & (directions != text.normals[number[first]]).any(axis=1)
    edits.replace(text.normal_spans[number[first][moved]], rows_as_text(directions[moved]))
    if keeps.all():
        return
    new = np.cumsum(~keeps) - 1
    begin = text.data.rfind(b"\n", 0, int(text.corner_spans[0, 0])) + 1
    edits.replace(
        [(begin, begin)], [b"".join(b"vn " + each + text.line_break for each in rows_as_text(directions[~keeps]))]
    )
    # The new lines stand before the first face, so the indices of all normals after this place increase.
    before = int(np.searchsorted(text.normal_spans[:, 0], begin))
    numbers = text.corners[:, 2].copy()
    numbers[numbers >= before] += len(pairs) - int(keeps.sum())
    numbers[corners[~keeps[pair]]] = before + new[pair[~keeps[pair]]]
    relative = b"-" in text.data[begin:]
    rewritten = np.flatnonzero((text.corners[:, 2] >= 0) & (relative | (numbers != text.corners[:, 2])))
    spans = text.corner_spans[rewritten]
    spans[:, 0] = [text.data.rfind(b"/", start, end) + 1 for start, end in spans.tolist()]
    edits.replace(spans, (b"%d" % each for each in (numbers[rewritten] + 1).tolist()))
