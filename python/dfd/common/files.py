"""Files that are whole or absent: written beside their place, then renamed into it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["atomic_write"]


@contextmanager
def atomic_write(path: str | os.PathLike[str], argument: str = "path") -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`; on success it takes the place of `path`, on failure it goes.

    The temporary file keeps the ending of `path`, so that writers that choose a format by it still can.

    Raises
    ------
    OSError
        If the folder does not exist or cannot be written, or the disk is full; an existing file stays as it was.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"`{argument}`: the folder {target.parent} does not exist")
    if target.is_dir():
        raise IsADirectoryError(f"`{argument}`: {target} is a folder, not a file")
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        # A writer may keep its file to itself; what it replaces, or an ordinary new file, says who may read it.
        temporary.touch()
        mode = (target if target.exists() else temporary).stat().st_mode
        yield temporary
        temporary.chmod(mode & 0o777)
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        temporary.replace(target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, f"`{argument}`: {target} could not be written: {reason}") from error
    finally:
        temporary.unlink(missing_ok=True)
