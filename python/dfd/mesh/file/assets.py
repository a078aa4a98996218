"""The folder of a mesh file, where trimesh looks for materials, textures and buffers that the file names."""

from __future__ import annotations

import io
from pathlib import Path

from PIL import Image
from trimesh.resolvers import FilePathResolver

__all__ = ["AssetFolder"]

_IMAGES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tga", ".tif", ".tiff", ".gif")


class AssetFolder(FilePathResolver):  # type: ignore[misc]  # trimesh is untyped to us
    """Reads files beside the mesh, never above its folder, and remembers which could not be read.

    trimesh goes on without a texture or materials file that it cannot read and tells nobody; `unreadable` does.
    """

    def __init__(self, mesh: Path) -> None:
        super().__init__(str(mesh))
        self.unreadable: set[str] = set()

    def get(self, name: str) -> bytes:
        """Return the bytes of file `name` of the folder.

        Raises
        ------
        ValueError, OSError
            If the name leads out of the folder or the file cannot be read.
        """
        try:
            data: bytes = super().get(name)
            if name.lower().strip().endswith(_IMAGES):
                with Image.open(io.BytesIO(data)) as image:
                    image.verify()  # cheap; what only decoding shows is told later
        except Exception:
            self.unreadable.add(name)
            raise
        return data

    def __getitem__(self, name: str) -> bytes:
        return self.get(name)
