"""Access to the materials, images and buffers that a mesh file references, and files that are not what they seem."""

from __future__ import annotations

import hashlib
from itertools import islice, takewhile
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from dfd.common.errors import ArgumentError
from dfd.common.files import read_regular
from dfd.common.linear_algebra import UInt8
from dfd.mesh.file.text import shortened
from dfd.mesh.images import as_texels, read_image

_MOST_LISTED = 10_000  # largest number of entries of a folder that are searched
MOST_TEXELS = 2**26  # largest total number of texels in the images of a file; as RGBA, these need 256 MiB

_LFS = b"version https://git-lfs"
_DISGUISES = {  # by the first bytes of a file
    _LFS: "a Git LFS pointer, which `git lfs pull` replaces by the file",
    **dict.fromkeys((b"\xff\xfe", b"\xfe\xff"), "text in the encoding UTF-16; convert it to UTF-8"),
    **dict.fromkeys((b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd"), "compressed data; decompress it first"),
    **dict.fromkeys((b"PK\x03\x04", b"Rar!", b"7z\xbc\xaf"), "an archive, such as a ZIP file; unpack it first"),
    **dict.fromkeys((b"<!doctype", b"<html", b"<head"), "an HTML page, as after a failed download"),
    **dict.fromkeys((b"<?xml", b"<"), "XML text"),
    **dict.fromkeys((b"\x89png", b"\xff\xd8\xff", b"gif8"), "a picture"),
    b"%pdf": "a PDF document",
    b"kaydara fbx": "an FBX file",
    b"blender": "a Blender file",
}
_MESHES = {b"gltf": ".glb", b"ply": ".ply", b"solid": ".stl", b"off": ".off", b"{": ".gltf"}  # by the first letters


class AssetFolder:
    """Reads the files that a mesh file names: by their path or, if there is none, by their file name.

    Upper and lower case count as equal if no file has the exact name. Hidden files and files outside a folder are
    refused: this folder is that of the mesh file, or `root`, such as the folder of an upload. By its file name alone, a
    file is found beside the mesh file, and with `root` anywhere in this folder.

    If an image or materials file cannot be read, loading continues. `unreadable` lists such files for a warning.
    """

    def __init__(self, mesh: Path, root: Path | None = None) -> None:
        self.folder, self.root = mesh.parent, root
        self.unreadable: set[str] = set()
        self.notes: set[str] = set()  # further warnings
        self._texels: dict[str, UInt8] = {}
        self._texels_left = MOST_TEXELS
        self._files: dict[str, list[Path]] | None = None  # by file name in lower case

    def read(self, name: str) -> bytes:
        """Return the bytes of the file `name`, a relative path or URI in the mesh file.

        Raises ValueError or OSError if `name` leads out of the folder or to a hidden file, or cannot be read.
        """
        refused: ValueError | None = None
        variants = [each.strip() for each in (name, unquote(name), unquote(name).replace("\\", "/"))]
        for find in (self._at, self._in_any_case, self._by_name):
            for variant in dict.fromkeys(variants):
                try:
                    path = find(variant)
                    if path is not None and (data := self._checked(name, path)) is not None:
                        return data
                except _Refused as error:
                    refused = refused or error.reason
        missing = ArgumentError("path", f"names {shortened(name)}, which does not exist: put it beside the file")
        raise refused or missing

    def _checked(self, name: str, path: Path) -> bytes | None:
        """Return the bytes of the file at `path`, or None if there is none; raise _Refused if it must not be read."""
        folder, path = (self.root or self.folder).resolve(), path.resolve()
        if not path.is_relative_to(folder):
            reason = f"names {shortened(name)}, which lies outside the folder of the file and is therefore not read"
            raise _Refused(ArgumentError("path", reason))
        if any(step.startswith(".") for step in path.relative_to(folder).parts):
            raise _Refused(ValueError(f"{shortened(name)} is a hidden file"))
        if not path.exists():
            return None
        data = read_regular(path)
        if data.startswith(_LFS):
            raise ArgumentError("path", f"names {shortened(name)}, which is {disguise(data, '')}")
        return data

    def _at(self, name: str) -> Path | None:
        return self.folder / name

    def _in_any_case(self, name: str) -> Path | None:
        """Return the path `name`, with each step in the case of the file system; None if there is no such path."""
        path = self.folder
        for step in PurePosixPath(name).parts:
            same = (each for each in _listed(path) if each.name.lower() == step.lower())
            found = path / step if (path / step).exists() else next(same, None)
            if found is None:
                return None
            path = found
        return path

    def _by_name(self, name: str) -> Path | None:
        """Return a file with the file name of the path `name`; of several files, the one with the most equal steps."""
        if self._files is None:
            self._files = {}
            for each in _listed(self.folder) if self.root is None else sorted(self.root.rglob("*")):
                if not each.is_dir():
                    self._files.setdefault(each.name.lower(), []).append(each)
        steps = PurePosixPath(name.replace("\\", "/").lower()).parts[::-1]
        found = self._files.get(steps[0], []) if steps else []

        def equal(path: Path) -> int:
            pairs = zip((each.lower() for each in path.parts[::-1]), steps, strict=False)
            return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))

        return max(found, key=equal, default=None)

    def texture(self, name: str, shown: str) -> UInt8 | None:
        """Return the texels of an image file. If it cannot be read, add `shown` to `unreadable` and return None."""
        try:
            return self.texels(self.read(name))
        except (ValueError, OSError):
            self.unreadable.add(shown)
            return None

    def texels(self, data: bytes) -> UInt8:
        """Return an image file as RGBA (rows, columns, 4), with the first row on top. Equal files are decoded once.

        An image above the limit is refused before it is decoded, because its header states its size.

        Raises ValueError if the image cannot be decoded, or the images of the mesh file have more than `MOST_TEXELS`.
        """
        key = hashlib.sha256(data).hexdigest()
        if key not in self._texels:
            width, height = read_image(data, lambda image: image.size)
            if width * height > self._texels_left:
                raise ValueError(
                    f"an image of {width} × {height} texels exceeds the limit of {MOST_TEXELS} texels in all images"
                )
            self._texels_left -= width * height
            self._texels[key] = read_image(data, as_texels)
        return self._texels[key]


class _Refused(Exception):  # noqa: N818  # another file may be found
    def __init__(self, reason: ValueError) -> None:
        super().__init__(reason)
        self.reason = reason


def _listed(folder: Path) -> list[Path]:
    """Return the entries of a folder, sorted by name; [] if the folder cannot be read."""
    try:
        return sorted(islice(folder.iterdir(), _MOST_LISTED))
    except OSError:
        return []


def disguise(data: bytes, ending: str) -> str | None:
    """Return what a file that is no mesh of the format `ending` seems to be; None if its first bytes do not tell."""
    begin = data[:64]
    if len(begin) > 8 and any(begin[1::2]) != any(begin[::2]):
        begin = b"\xff\xfe"  # every other byte of UTF-16 text is 0
    start = begin.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    for mark, what in _DISGUISES.items():
        if begin.startswith(mark) or start.startswith(mark.lower()):
            return what
    other = next((each for mark, each in _MESHES.items() if start.startswith(mark)), ending)
    return None if {ending, other} in ({ending}, {".glb", ".gltf"}) else f"content of the format {other[1:].upper()}"
