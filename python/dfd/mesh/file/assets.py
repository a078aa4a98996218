"""Access to the materials, images and buffers that a mesh file references."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from pathlib import Path
from urllib.parse import unquote

from dfd.common.errors import ArgumentError
from dfd.common.images import as_texels, read_image
from dfd.common.linear_algebra import UInt8
from dfd.common.text import shortened

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
MOST_TEXELS = 2**26  # largest total number of texels in the images of a file; as RGBA, these need 256 MiB


class AssetFolder:
    """Reads files in the folder of a mesh file and its subfolders; refuses hidden files and paths outside the folder.

    If an image or materials file cannot be read, loading continues. `unreadable` lists such files for a warning.
    """

    def __init__(self, mesh: Path) -> None:
        self.folder = mesh.parent
        self.unreadable: set[str] = set()
        self._texels: dict[str, UInt8] = {}
        self._texels_left = MOST_TEXELS

    def read(self, name: str) -> bytes:
        """Return the bytes of the file `name`, a relative path or URI in the mesh file.

        Raises ValueError or OSError if `name` leads out of the folder or to a hidden file, or cannot be read.
        """
        folder = self.folder.resolve()
        for variant in dict.fromkeys((name, unquote(name), unquote(name).replace("\\", "/"))):
            path = (folder / variant.strip()).resolve()
            if not path.is_relative_to(folder):
                reason = f"names {shortened(name)}, which lies outside the folder of the file and is therefore not read"
                raise ArgumentError("path", reason)
            if any(step.startswith(".") for step in path.relative_to(folder).parts):
                raise ValueError(f"{shortened(name)} is a hidden file")
            if path.exists():
                data = read_regular(path)
                if data.startswith(_LFS):
                    raise ArgumentError("path", f"names {shortened(name)}, which is {_DISGUISES[_LFS]}")
                return data
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), shortened(name))

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


def read_regular(path: Path) -> bytes:
    """Return the bytes of a regular file.

    Raises OSError if `path` is a pipe or a device, without waiting for data. Raises OSError if the read fails.
    """
    if path.exists() and not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "it is not a file")
    # O_NONBLOCK: if a pipe has replaced the file since the check, `open` does not wait for a writer
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as stream:
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise OSError(errno.EINVAL, "it is not a file")
        return stream.read()


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
