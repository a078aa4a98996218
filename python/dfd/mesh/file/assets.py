"""Access to the materials, images and buffers that a mesh file references."""

from __future__ import annotations

import hashlib
from pathlib import Path
from urllib.parse import unquote

from dfd.common.disguise import disguise, is_pointer
from dfd.common.errors import ArgumentError
from dfd.common.files import read_regular
from dfd.common.images import as_texels, read_image
from dfd.common.linear_algebra import UInt8
from dfd.common.text import shortened

MOST_TEXELS = 2**26  # largest total number of texels in the images of a file; as RGBA, these need 256 MiB


class AssetFolder:
    """Reads files in the folder of a mesh file and its subfolders; refuses hidden files and paths outside the folder.

    If an image or materials file cannot be read, loading continues. `unreadable` lists such files for a warning.
    """

    def __init__(self, mesh: Path) -> None:
        self.folder = mesh.parent
        self.unreadable: set[str] = set()
        self.notes: set[str] = set()  # further warnings
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
                if is_pointer(data):
                    raise ArgumentError("path", f"names {shortened(name)}, which is {disguise(data, '')}")
                return data
        raise ArgumentError("path", f"names {shortened(name)}, which does not exist: put it beside the file")

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
