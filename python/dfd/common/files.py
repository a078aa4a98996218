"""Write files atomically, by renaming a temporary file, and find the cache folder."""

import errno
import hashlib
import os
import re
import secrets
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_ABANDONED = 3600.0  # seconds without a change, after which a temporary file is deleted
LONGEST_STEM = 80  # characters
_LONGEST_ENDING = 32  # bytes; a temporary file has the ending of its target, unless that ending is longer


def cache_directory() -> Path:
    """Return the user's cache folder for `dfd`, which need not exist yet.

    The environment variable DFD_CACHE sets this folder. Without DFD_CACHE, the folder is `dfd` in the platform's cache
    folder. On Linux, that is XDG_CACHE_HOME or ~/.cache.
    """
    import platformdirs  # imported only here: Blender lacks it, and dfd's add-on for Blender uses no cache

    named = os.environ.get("DFD_CACHE")
    return Path(named).expanduser() if named else platformdirs.user_cache_path("dfd", appauthor=False)


def data_directory() -> Path:
    """Return the user's data folder for `dfd`, which need not exist yet.

    The environment variable DFD_DATA sets this folder. Without DFD_DATA, the folder is `dfd` in the platform's folder
    for data of programs. On Linux, that is XDG_DATA_HOME or ~/.local/share.
    """
    import platformdirs

    named = os.environ.get("DFD_DATA")
    return Path(named).expanduser() if named else platformdirs.user_data_path("dfd", appauthor=False)


def plain(value: Any) -> Any:
    """Convert a NumPy array or number to Python values, and other objects to text, as the `default` of `json.dumps`."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def sha256_of_files(*paths: Path) -> str:
    """Return the SHA-256 of the concatenated contents of files, as 64 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as stream:
            while data := stream.read(1 << 20):
                digest.update(data)
    return digest.hexdigest()


@contextmanager
def atomic_write(path: str | os.PathLike[str], argument: str = "path") -> Iterator[Path]:
    """Yield the path of a temporary file, which replaces `path` after the `with` block, or is deleted after an error.

    The temporary file has the ending of `path`, so writers can choose the format by the ending. If `path` is a
    symbolic link, the link stays and its target is replaced. A killed process leaves its temporary file in the folder
    of `path`. After an hour, the next write of `path` deletes that file.

    Raises OSError, and keeps an existing file, if the folder is missing, `path` is no regular file or writing fails.
    """
    target = resolved_target(Path(path), argument)
    try:
        temporary = _temporary(target)
        try:
            # The block may change permissions. The written file gets those of the replaced file, or of a new file.
            mode = (target if target.exists() else temporary).stat().st_mode
            yield temporary
            temporary.chmod(mode & 0o777)
            with temporary.open("rb+") as stream:
                os.fsync(stream.fileno())
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(error.errno, f"`{argument}`: {Path(path)} could not be written: {reason}") from error


def write_file(path: str | os.PathLike[str], content: str | bytes, argument: str = "path") -> None:
    """Write bytes, or text in UTF-8, to a file by `atomic_write`."""
    with atomic_write(path, argument) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def resolved_target(path: Path, argument: str) -> Path:
    """Return the file that a write to `path` replaces: `path` itself or, for a symbolic link, the link's target.

    Raises OSError, which names `argument`, if the folder does not exist or `path` is a folder, a device or a pipe.
    """
    try:
        target = path.resolve() if path.is_symlink() else path
        exists = target.exists()
    except (OSError, RuntimeError) as error:  # a symbolic link to itself, or a name that is too long
        number = getattr(error, "errno", None) or errno.ELOOP
        raise OSError(number, f"`{argument}`: {path} could not be written: {os.strerror(number)}") from error
    if not target.parent.is_dir():
        raise FileNotFoundError(f"`{argument}`: the folder {target.parent} does not exist")
    if target.is_dir():
        raise IsADirectoryError(f"`{argument}`: {path} is a folder, not a file")
    if exists and not target.is_file():
        raise OSError(errno.EINVAL, f"`{argument}` must be a regular file, got {path}")
    return target


def _temporary(target: Path) -> Path:
    """Create an empty temporary file beside `target`, and delete old files that killed processes left."""
    ending = target.suffix if len(os.fsencode(target.suffix)) <= _LONGEST_ENDING else ""
    # The name is hashed, because file systems allow 255 bytes, and the target's name alone may have that length.
    start = f".dfd-{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}-"
    for leftover in target.parent.glob(f"{start}*"):
        with suppress(OSError):  # another process removed it, or another user owns it
            if time.time() - leftover.stat().st_mtime > _ABANDONED:
                leftover.unlink()
    path = target.with_name(f"{start}{secrets.token_hex(8)}{ending}")
    path.touch(exist_ok=False)
    return path


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


def file_stem(name: str) -> str:
    """Return the name of a file without its ending; "_" replaces characters that a file system may reject."""
    stem = re.sub(r"\.[A-Za-z0-9]{1,8}$", "", name)
    return re.sub(r"[^\w-]+", "_", stem)[:LONGEST_STEM].strip("_") or "mesh"
