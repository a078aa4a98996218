"""Files that are written beside their place, then renamed into it; and the folder of the cache."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_ABANDONED = 3600.0  # seconds after which an unfinished file is removed
_LONGEST_ENDING = 32  # bytes of an ending that the temporary file keeps


def cache_directory() -> Path:
    """Return the user's cache folder for `dfd`; it need not exist yet.

    The environment variable DFD_CACHE names it outright; otherwise it follows the habit of the platform, on Linux
    XDG_CACHE_HOME or ~/.cache.
    """
    import platformdirs  # Blender has none, and asks for no cache

    named = os.environ.get("DFD_CACHE")
    return Path(named).expanduser() if named else platformdirs.user_cache_path("dfd", appauthor=False)


def plain(value: Any) -> Any:
    """Return what `json.dumps` writes for an array or a number of NumPy, and text for anything else."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def sha256_of_files(*paths: Path) -> str:
    """Return the SHA-256 of the content of files, one after the other, 64 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as stream:
            while data := stream.read(1 << 20):
                digest.update(data)
    return digest.hexdigest()


@contextmanager
def atomic_write(path: str | os.PathLike[str], argument: str = "path") -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it takes the place of `path`, on failure it goes.

    The temporary file keeps the ending of `path`, so that writers that choose a format by it still can. A symbolic
    link stays one: the file it leads to is replaced. What a killed process left behind goes with a write of the same
    file an hour later.

    Raises OSError if the folder does not exist or cannot be written, the disk is full, or `path` is a folder, a device,
    a pipe or anything else that is no file; an existing file stays as it was.
    """
    named, target = Path(path), _target(Path(path), argument)
    temporary = None
    try:
        temporary = _temporary(target)
        # A writer may keep its file to itself; what it replaces, or an ordinary new file, says who may read it.
        mode = (target if target.exists() else temporary).stat().st_mode
        yield temporary
        temporary.chmod(mode & 0o777)
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        temporary.replace(target)
        temporary = None
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, f"`{argument}`: {named} could not be written: {reason}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def _target(path: Path, argument: str) -> Path:
    """Return the file that `path` leads to, which need not exist."""
    try:
        target = path.resolve() if path.is_symlink() else path
        found = target.stat().st_mode if target.exists() else None
    except (OSError, RuntimeError) as error:  # a link that leads to itself; a name that is too long
        number = getattr(error, "errno", None) or errno.ELOOP
        raise OSError(number, f"`{argument}`: {path} could not be written: {os.strerror(number)}") from error
    if not target.parent.is_dir():
        raise FileNotFoundError(f"`{argument}`: the folder {target.parent} does not exist")
    if found is not None and stat.S_ISDIR(found):
        raise IsADirectoryError(f"`{argument}`: {path} is a folder, not a file")
    if found is not None and not stat.S_ISREG(found):
        raise OSError(errno.EINVAL, f"`{argument}`: {path} is not a file, and nothing is written to it")
    return target


def _temporary(target: Path) -> Path:
    """Make an empty file beside `target`, and remove those that killed processes left there for the same target."""
    ending = target.suffix if len(os.fsencode(target.suffix)) <= _LONGEST_ENDING else ""
    # a name of its own, not the target's made longer: file systems allow 255 bytes
    start = f".dfd-{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}-"
    for left in target.parent.glob(f"{start}*"):
        with suppress(OSError):  # another process removed it, or it is somebody else's
            if time.time() - left.stat().st_mtime > _ABANDONED:
                left.unlink()
    path = target.with_name(f"{start}{secrets.token_hex(8)}{ending}")
    path.touch(exist_ok=False)
    return path
