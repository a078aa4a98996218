"""Files that a person drops on the page, put into a folder of their own under names that lead nowhere else."""

from __future__ import annotations

import lzma
import re
import secrets
import shutil
import struct
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from dfd.app.options import OpenedFile, Source, Upload
from dfd.mesh.file.read import ENDINGS

FORMATS = (*ENDINGS, ".zip", ".safetensors", ".json")
FIELD, EDIT = ".safetensors", ".json"
MOST_FILES = 500
DEEPEST = 6  # folders inside a zip
CHUNK = 1 << 20  # bytes
# Texture paths that a materials file may name: plain words, without a dot in front and with nothing that leads out.
SAFE = re.compile(r"[\w+()\[\]@=,' -][\w.+()\[\]@=,' -]{0,120}")


@dataclass(frozen=True)
class UploadedFile:
    """A file as it came: the name is what the browser said, and is believed for its ending and its looks alone."""

    name: str
    stream: IO[bytes]


def receive(files: Sequence[UploadedFile], folder: Path, most_bytes: int) -> Upload:
    """Put `files` into a new folder inside `folder`; return what to open.

    The mesh, the field and the edit get names of ours. What a mesh names beside itself (materials, textures, buffers)
    keeps its name where that is harmless, and is left out where it is not.

    Raises ValueError if there is nothing to open among them, or more than one mesh, or they are too large or too many,
    or a zip is damaged or names a place outside itself.
    """
    place = folder / secrets.token_hex(16)
    place.mkdir(parents=True)
    try:
        return _receive(files, place, most_bytes)
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise


def _receive(files: Sequence[UploadedFile], place: Path, most_bytes: int) -> Upload:
    given: dict[str, Path] = {}  # by the name inside the upload
    left = most_bytes
    for file in files:
        if _ending(file.name) == ".zip":
            left -= _unpack(file, place, given, left)
        else:
            left -= _keep(file.name, file.stream, place, given, left)
    meshes = [name for name in given if _ending(name) in ENDINGS]
    if len(meshes) > 1:
        raise ValueError(f"Open one mesh at a time, got {', '.join(_last(name) for name in sorted(meshes)[:5])}")
    mesh = None
    if meshes:
        path = _renamed(given[meshes[0]], "mesh")
        mesh = Source(name=_last(meshes[0]), path=path)
    field, edit = (_single(given, ending, beside_mesh=bool(meshes)) for ending in (FIELD, EDIT))
    if mesh is None and field is None and edit is None:
        names = ", ".join(_last(name) for name in list(given)[:5]) or "nothing"
        raise ValueError(f"There must be a file that ends in one of {', '.join(FORMATS)}, got {names}")
    return Upload(place, mesh, field, edit)


def _single(given: Mapping[str, Path], ending: str, *, beside_mesh: bool) -> OpenedFile | None:
    """The one file of that ending; none where it belongs to the mesh, or to nobody."""
    names = [name for name in given if _ending(name) == ending]
    if not names:
        return None
    if len(names) > 1:
        if beside_mesh:
            return None
        raise ValueError(f"Open one {ending} file at a time, got {', '.join(_last(name) for name in names[:5])}")
    return OpenedFile(name=_last(names[0]), path=_renamed(given[names[0]], ending[1:]))


def _unpack(file: UploadedFile, place: Path, given: dict[str, Path], left: int) -> int:
    """Put the files of a zip in place; return their bytes."""
    used = 0
    try:
        with zipfile.ZipFile(file.stream) as archive:
            for entry in archive.infolist():
                name = entry.filename.replace("\\", "/")
                path = PurePosixPath(name)
                if path.is_absolute() or ".." in path.parts or re.match(r"[A-Za-z]:", name):
                    raise ValueError(f"{_shown(file.name)} names a place outside itself: {_shown(entry.filename)}")
                if entry.is_dir() or path.parts[:1] in ((), ("__MACOSX",)):
                    continue
                with archive.open(entry) as stream:
                    used += _keep(name, stream, place, given, left - used)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, lzma.LZMAError, NotImplementedError, RuntimeError,
            EOFError, OSError, struct.error) as error:  # fmt: skip
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error  # without the path
        raise ValueError(f"{_shown(file.name)} is damaged or not a zip that can be read: {reason}") from None
    return used


def _keep(name: str, stream: IO[bytes], place: Path, given: dict[str, Path], left: int) -> int:
    """Write one file, unless its name is harmful and nobody needs it; return its bytes."""
    if len(given) >= MOST_FILES:
        raise ValueError(f"An upload must have at most {MOST_FILES} files")
    steps = [step for step in name.replace("\\", "/").split("/") if step not in ("", ".")]
    opened = _ending(name) in FORMATS
    rooted = name.startswith(("/", "\\"))
    harmless = not rooted and 0 < len(steps) <= DEEPEST and all(SAFE.fullmatch(step) for step in steps)
    if not harmless and not opened:
        return 0
    path = place.joinpath(*(steps if harmless else [f"{len(given)}{_ending(name)}"]))
    if name in given or path.exists() or not all(above.is_dir() for above in path.parents if above.exists()):
        raise ValueError(f"An upload must have each file once, got {_shown(name)} twice")
    path.parent.mkdir(parents=True, exist_ok=True)
    size = 0
    with path.open("xb") as target:
        while chunk := stream.read(CHUNK):
            size += len(chunk)
            if size > left:
                raise ValueError("The files are larger than this server takes")
            target.write(chunk)
    given[name] = path
    return size


def _renamed(path: Path, stem: str) -> Path:
    """The file under a name of ours, in its folder, where what it names is."""
    target = path.with_name(f"{stem}-{secrets.token_hex(4)}{path.suffix.lower()}")
    path.rename(target)
    return target


def _ending(name: str) -> str:
    return PurePosixPath(name.replace("\\", "/")).suffix.lower()[:20]


def _last(name: str) -> str:
    return _shown(name.replace("\\", "/").rsplit("/", 1)[-1])


def _shown(name: str) -> str:
    """A name as a sentence can hold it."""
    return re.sub(r"[\x00-\x1f\x7f]", "?", name)[:100] or "a file without a name"
