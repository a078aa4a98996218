"""Read mesh files in OBJ, PLY, STL, OFF, GLB and glTF format."""

import errno
import os
import re
from pathlib import Path

from dfd.common import check
from dfd.common.errors import ArgumentError, one_line
from dfd.common.files import read_regular
from dfd.mesh.file.assets import AssetFolder, disguise
from dfd.mesh.file.formats import FORMATS
from dfd.mesh.file.scene_file import SceneFile

_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/", re.IGNORECASE)  # `Path` removes one of the two slashes
_MOST_NAMED = 5  # largest number of unreadable files that a warning lists


def read(path: str | os.PathLike[str], *, at_rest: bool = True, root: Path | None = None) -> SceneFile:
    """Return the scene of a file, in the bind pose if `at_rest` is False. Raises the errors of `dfd.load`.

    Files that it names may be anywhere in the folder `root`; without `root`, in the folder of the file.
    """
    if _ADDRESS.match(os.fspath(path)):
        raise ArgumentError("path", f"is an address, got {path}: download the file, and give its path", "load")
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise ArgumentError("path", f"must end in {', '.join(FORMATS)}, got {path}", "load")
    try:
        data = read_regular(path)
    except OSError as error:
        raise OSError(error.errno, f"load: `path` {path} could not be read: {error.strerror}") from error
    if not data:
        raise ArgumentError("path", f"{path} is empty", "load")
    assets = AssetFolder(path, root)
    try:
        scene = FORMATS[ending].read(path, data, assets, at_rest)
    except MemoryError as error:
        raise OSError(errno.ENOMEM, f"load: `path` {path} needs more memory than is available") from error
    except UserWarning:
        raise
    except Exception as error:  # for malformed files, libraries raise errors of any type
        raise ArgumentError("path", f"{path} {_reason(ending, data, error)}", "load") from error
    if assets.unreadable:
        names = ", ".join(each[:100] for each in sorted(assets.unreadable)[:_MOST_NAMED])
        names += ", …" if len(assets.unreadable) > _MOST_NAMED else ""
        check.warn(f"load: `path` {path} names {names}, which could not be read; affected faces are gray", UserWarning)
    if assets.notes:
        notes = sorted(assets.notes)
        more = f" (and {len(notes) - _MOST_NAMED} more)" if len(notes) > _MOST_NAMED else ""
        check.warn(f"load: in `path` {path}, {', '.join(notes[:_MOST_NAMED])}{more}", UserWarning)
    return scene


def _reason(ending: str, data: bytes, error: Exception) -> str:
    """Return what is wrong with the content of a file, which could not be read because of `error`."""
    other = disguise(data, ending)
    if other is not None:
        return f"is not a mesh file in {ending[1:].upper()} format, but {other}"
    if isinstance(error, ArgumentError):  # the file is well-formed, but its content is no valid mesh
        return error.reason
    kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
    reason = one_line(f"{kind}{error}").removesuffix(":")[:300]
    return f"is not a well-formed {ending[1:].upper()} file: {reason}"
