"""Pieces of work in a folder, each a file that is whole, is what it says it is, or counts as none."""

from __future__ import annotations

import contextlib
import hashlib
import os
import threading
from pathlib import Path

from dfd.common.files import atomic_write
from dfd.common.warn import warn

__all__ = ["PieceFolder"]

_HASH = 32  # bytes of SHA-256 before the content


class PieceFolder:
    """Files of a folder, each with a hash of its name and its content before the content."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self._warned = False
        self._warning = threading.Lock()  # pieces are written by several threads

    def read(self, name: str) -> bytes | None:
        """Return the content of a piece; None where there is none, and, with a warning, where it is damaged."""
        try:
            piece = (self.folder / name).read_bytes()
        except OSError:
            return None
        content = piece[_HASH:]
        if piece[:_HASH] != _hash(name, content):
            self.reject(name)
            return None
        return content

    def reject(self, name: str) -> None:
        """Say that a piece is not what it should be, and begins anew."""
        warn(f"distill: {self.folder / name} is damaged or of something else: it is begun anew", UserWarning)

    def write(self, name: str, content: memoryview | bytes) -> None:
        """Keep a piece, whole or not at all; where that cannot be done, say so once and go on."""
        try:
            with atomic_write(self.folder / name, "checkpoint") as temporary, temporary.open("wb") as stream:
                stream.write(_hash(name, content))
                stream.write(content)
        except OSError as error:
            with self._warning:
                warned, self._warned = self._warned, True
            if not warned:
                warn(
                    f"distill: {error.strerror or error}; the run goes on, but could not be taken up again from here",
                    RuntimeWarning,
                )

    def remove(self, *patterns: str) -> None:
        """Take away the files whose names match."""
        for pattern in patterns:
            for path in self.folder.glob(pattern):
                with contextlib.suppress(OSError):
                    path.unlink()


def _hash(name: str, content: memoryview | bytes) -> bytes:
    sha256 = hashlib.sha256(f"{name}\n".encode())
    sha256.update(content)
    return sha256.digest()
