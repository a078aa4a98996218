"""Files written next to an OBJ file: its material library, `<stem>.mtl`, and textures."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from dfd.mesh.file.assets import AssetFolder, image_format, read_regular
from dfd.mesh.file.obj.read import picture_name, used_materials
from dfd.mesh.file.obj.text import ObjText, decoded

_PICTURES = (".bmp", ".gif", ".jpeg", ".jpg", ".png", ".tga", ".tif", ".tiff", ".webp")


class Companions:
    """The files written next to an OBJ file; unrelated files are never overwritten.

    A file may be overwritten if the existing OBJ file or its materials reference it and its name begins with the OBJ
    file's stem.
    """

    def __init__(self, target: Path) -> None:
        self.files: dict[str, bytes] = {}
        self._target = target
        self._own = _own_files(target)

    def add(self, name: str, data: bytes) -> str:
        """Add a file and return its name, with a number if an unrelated file has that name."""
        path, number = PurePosixPath(name), 1
        while not self._is_free(name, data):
            number += 1
            name = f"{path.stem}_{number}{path.suffix}"
        self.files[name] = data
        return name

    def add_library(self, text: str) -> str:
        """Add the material library and return its name."""
        return self.add(f"{self._target.stem}.mtl", text.encode())

    def _is_free(self, name: str, data: bytes) -> bool:
        if name == self._target.name:
            return False
        if name in self.files:
            return self.files[name] == data
        path = self._target.with_name(name)
        if name in self._own or not (path.exists() or path.is_symlink()):
            return True
        return path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data


def copied_materials(text: ObjText, source: Path, companions: Companions) -> tuple[str | None, set[str]]:
    """Copy the materials that an OBJ file uses, and their textures, next to the written file.

    Only used materials are copied, from the folder `source`, and only textures that are valid images. Return the name
    of the new material library, or None if no material is used, and the names of all readable libraries.
    """
    assets = AssetFolder(source / "materials")
    materials, read = used_materials(text, assets)
    if not materials:
        return None, read
    copied: list[str] = []
    for name, lines in materials.items():
        copied += [f"newmtl {name}", *(_with_copied_picture(line, assets, companions) for line in lines), ""]
    return companions.add_library("".join(f"{line}\n" for line in copied)), read


def _with_copied_picture(line: str, assets: AssetFolder, companions: Companions) -> str:
    name = picture_name(line)
    if not name:
        return line
    try:
        data = assets.read(name)
        kind = image_format(data)
    except (ValueError, OSError):  # keep the reference
        return line
    path = PurePosixPath(name.replace("\\", "/"))
    plain = path.name if path.suffix.lower() in _PICTURES else f"{path.stem}.{kind}"
    added = companions.add(plain, data)
    return line[: len(line) - len(name)] + added if line.endswith(name) else line.replace(name, added)


def _own_files(target: Path) -> set[str]:
    """Return the names of the files that an existing OBJ file `target` references and that begin with its stem."""
    mine = re.compile(rf"{re.escape(target.stem)}(_.*)?\.[A-Za-z0-9]+")
    found = set()
    try:
        for library in re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", read_regular(target), re.MULTILINE):
            name = decoded(library).strip()
            if mine.fullmatch(name) and name.endswith(".mtl"):
                found.add(name)
                lines = decoded(read_regular(target.with_name(name))).splitlines()
                found |= {each for each in map(picture_name, lines) if mine.fullmatch(each)}
    except (OSError, ValueError):
        pass
    return {name for name in found if "/" not in name and "\\" not in name}
