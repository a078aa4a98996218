"""Files that are whole or absent: written beside their place, then renamed into it; and where made things are kept."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_WRITERS = 16  # of one file at the same time; more of them get names that are never reused
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
    """Arrays, numbers of NumPy and paths as JSON has them: the `default` of `json.dumps`."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


@contextmanager
def atomic_write(path: str | os.PathLike[str], argument: str = "path") -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it takes the place of `path`, on failure it goes.

    The temporary file keeps the ending of `path`, so that writers that choose a format by it still can. A symbolic
    link stays one: the file it leads to is replaced. What a killed process left behind goes with the next write of
    the same file.

    Raises OSError if the folder does not exist or cannot be written, the disk is full, or `path` is a folder, a device,
    a pipe or anything else that is no file; an existing file stays as it was.
    """
    named, target = Path(path), _target(Path(path), argument)
    temporary, held = None, -1
    try:
        temporary, held = _temporary(target)
        # A writer may keep its file to itself; what it replaces, or an ordinary new file, says who may read it.
        mode = (target if target.exists() else temporary).stat().st_mode
        yield temporary
        temporary.chmod(mode & 0o777)
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        temporary.replace(target)
        temporary = None  # by now another writer may have taken the name
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, f"`{argument}`: {named} could not be written: {reason}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        if held >= 0:
            os.close(held)


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


def _temporary(target: Path) -> tuple[Path, int]:
    """Make an empty file beside `target`; return it and what holds its lock, -1 on systems without.

    Names are few and follow from the target's, so that what a killed process left is met again, whatever else lies
    in the folder. A lock tells it from the file of a process that is still writing.
    """
    ending = target.suffix if len(os.fsencode(target.suffix)) <= _LONGEST_ENDING else ""
    # a name of its own, not the target's made longer: file systems allow 255 bytes
    digest = hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]
    if sys.platform != "win32":
        _sweep(target.with_name(f".dfd-{digest}-{writer}{ending}") for writer in range(_WRITERS))
        for writer in range(_WRITERS):
            path = target.with_name(f".dfd-{digest}-{writer}{ending}")
            with suppress(FileExistsError):
                held = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
                if _lock(held) is not False and _is_at(path, held):
                    return path, held
                os.close(held)  # another process swept it before it was locked
    path = target.with_name(f".dfd-{digest}-{secrets.token_hex(8)}{ending}")
    path.touch(exist_ok=False)
    return path, -1


if sys.platform != "win32":
    import fcntl

    def _sweep(leftovers: Iterator[Path]) -> None:
        """Remove the files that no process holds."""
        for path in leftovers:
            try:
                held = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError:  # it is not there, or is somebody else's
                continue
            try:
                if _lock(held) and _is_at(path, held):
                    path.unlink(missing_ok=True)
            finally:
                os.close(held)

    def _lock(held: int) -> bool | None:
        """Lock an open file; return whether it is ours now, None on a file system without locks."""
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            return False if error.errno in (errno.EWOULDBLOCK, errno.EACCES) else None
        return True

    def _is_at(path: Path, held: int) -> bool:
        """Whether an open file is the one at `path`."""
        try:
            return os.path.samestat(path.stat(), os.fstat(held))
        except OSError:
            return False
