"""Access to the materials, images and buffers that a mesh file references."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from urllib.parse import unquote


class AssetFolder:
    """Reads regular files below the mesh's folder; refuses paths outside it and hidden files.

    Loading continues without image or materials files that cannot be read; `unreadable` lists them for a warning.
    """

    def __init__(self, mesh: Path) -> None:
        self.folder = mesh.parent
        self.unreadable: set[str] = set()

    def read(self, name: str) -> bytes:
        """Return the bytes of the file `name`, a relative path or URI in the mesh file.

        Raises ValueError or OSError if `name` leads out of the folder or to a hidden file, or cannot be read.
        """
        folder = self.folder.resolve()
        for spelled in dict.fromkeys((name, unquote(name), unquote(name).replace("\\", "/"))):
            path = (folder / spelled.strip()).resolve()
            if not path.is_relative_to(folder):
                raise ValueError(f"{shortened(name)} lies outside the folder of the file")
            if any(step.startswith(".") for step in path.relative_to(folder).parts):
                raise ValueError(f"{shortened(name)} is a hidden file")
            if path.exists():
                return read_regular(path)
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), shortened(name))

    def has(self, name: str) -> bool:
        """Return whether `read` would find a file with this name."""
        try:
            self.read(name)
        except (ValueError, OSError):
            return False
        return True


def read_regular(path: Path) -> bytes:
    """Return the bytes of a regular file; refuse pipes and devices without blocking.

    Raises OSError if `path` is not a regular file, or cannot be read.
    """
    if path.exists() and not stat.S_ISREG(path.stat().st_mode):
        raise OSError(errno.EINVAL, "it is not a file")
    # O_NONBLOCK: a pipe may have replaced the file after the check, and must not block `open`
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as stream:
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise OSError(errno.EINVAL, "it is not a file")
        return stream.read()


def shortened(value: object) -> str:
    """Return a value of a file as text for an error message, cut to about 60 characters."""
    text = repr(value)
    if isinstance(value, str) and value.startswith("data:"):
        return f"a data URI of {len(value)} characters"
    return text if len(text) <= 60 else f"{text[:50]}… ({len(text)} characters)"
