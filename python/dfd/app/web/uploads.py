"""Store the files of an upload in a new folder, under safe names."""

import lzma
import re
import secrets
import shutil
import struct
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import IO

from dfd.app.options import OpenedFile, Opening
from dfd.mesh.file.formats import ENDINGS

FIELD, EDIT = ".safetensors", ".json"
FORMATS = (*ENDINGS, ".zip", FIELD, EDIT)
MESHES = "OBJ, PLY, STL, OFF, glTF or GLB"  # the endings, as users know them
MOST_FILES = 500
DEEPEST = 6  # largest depth of folders in a ZIP file
CHUNK = 1 << 20  # bytes
# Endings of files that meshes name, which the page lets users choose beside the mesh.
BESIDE = (".mtl", ".bin", ".png", ".jpg", ".jpeg", ".webp", ".tga", ".bmp", ".tif", ".tiff", ".gif")
LONGEST_NAME = 120  # characters of a folder or a file
RESERVED = re.compile(r'[/\\:*?"<>|]')  # characters that some systems do not allow in file names
UNREADABLE = (zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, lzma.LZMAError, NotImplementedError, RuntimeError,
              EOFError, OSError, struct.error)  # fmt: skip


def receive(files: Sequence[tuple[str, IO[bytes]]], folder: Path, most_bytes: int) -> Opening:
    """Store `files`, with names from the browser, in a new folder inside `folder`; return the files to open.

    The mesh, the field and the edit get random names. All other files, such as textures of the mesh, keep their names.
    Files with unsafe names are left out, and so are the files in which macOS keeps attributes of others.

    Raises ValueError if the files are too large or too many, a file occurs twice, or a ZIP file is damaged. Raises
    ValueError if no file can be opened, there are several meshes, or there are several fields or edits without a mesh.
    """
    place = folder / secrets.token_hex(16)
    place.mkdir(parents=True)
    try:
        given = _Upload(place, most_bytes)
        for name, stream in files:
            (given.unpack if _ending(name) == ".zip" and not _is_of_macos(name) else given.keep)(name, stream)
        mesh = given.single(ENDINGS)
        field, edit = (given.single((ending,), ignore_several=mesh is not None) for ending in (FIELD, EDIT))
        if mesh is None and field is None and edit is None:
            packed = next((name for name in given.paths if _ending(name) == ".zip"), None)
            if packed is not None:
                raise ValueError(f"{_last(packed)} is a ZIP file in a ZIP file: unpack it, and open its files")
            names = ", ".join(map(_last, list(given.paths)[:5])) or "An upload without files"
            raise ValueError(f"{names} cannot be opened: open {MESHES}; convert FBX with Blender")
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise
    return Opening(mesh, field, edit, place)


class _Upload:
    """The stored files of one upload. `paths` maps each file's name in the upload to its path on disk."""

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self.paths: dict[str, Path] = {}
        self._folder, self._bytes_left = folder, most_bytes

    def unpack(self, name: str, file: IO[bytes]) -> None:
        """Store the files of a ZIP file."""
        try:
            with zipfile.ZipFile(file) as archive:
                for entry in archive.infolist():
                    if not entry.is_dir() and not _is_of_macos(entry.filename):
                        with archive.open(entry) as stream:
                            self.keep(entry.filename, stream)
        except UNREADABLE as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else error  # contains no path
            raise ValueError(f"{_shown(name)} is damaged or not a zip that can be read: {reason}") from None

    def keep(self, name: str, stream: IO[bytes]) -> None:
        """Store one file: a file of `FORMATS` under a random name, any other file only if its name is safe."""
        if _is_of_macos(name):
            return
        if len(self.paths) >= MOST_FILES:
            raise ValueError(f"An upload must have at most {MOST_FILES} files")
        steps = [step for step in name.replace("\\", "/").split("/") if step != "."]
        original, ending = "/".join(steps), _ending(name)
        safe = len(steps) <= DEEPEST and all(map(is_safe, steps))
        if ending in FORMATS:
            steps = [*(steps[:-1] if safe else []), f"{secrets.token_hex(8)}{ending}"]
        elif not safe:
            return
        path = self._folder.joinpath(*steps)
        if original in self.paths or path.exists() or not all(each.is_dir() for each in path.parents if each.exists()):
            raise ValueError(f"An upload must have each file once, got {_shown(name)} twice")
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as target:
            while chunk := stream.read(CHUNK):
                self._bytes_left -= len(chunk)
                if self._bytes_left < 0:
                    raise ValueError("The files are larger than this server takes")
                target.write(chunk)
        self.paths[original] = path

    def single(self, endings: Sequence[str], *, ignore_several: bool = False) -> OpenedFile | None:
        """Return the only file with one of `endings`, or None. Two or more raise ValueError unless `ignore_several`."""
        names = [name for name in self.paths if _ending(name) in endings]
        if len(names) > 1 and not ignore_several:
            raise ValueError(f"Open one {_ending(names[0])} file at a time, got {', '.join(map(_last, names[:5]))}")
        return OpenedFile(_last(names[0]), self.paths[names[0]], self._folder) if len(names) == 1 else None


def is_safe(step: str) -> bool:
    """Return whether a name of a folder or a file can be used: it is not hidden, and no system reserves it."""
    usual = step.isprintable() and not step.startswith(".") and not RESERVED.search(step)
    return usual and 0 < len(step) <= LONGEST_NAME and step == step.strip()


def _is_of_macos(name: str) -> bool:
    """Return whether a file has attributes of another file, such as ._a.obj, or shows a folder of macOS."""
    steps = name.replace("\\", "/").split("/")
    return "__MACOSX" in steps or steps[-1].startswith("._") or steps[-1] == ".DS_Store"


def _ending(name: str) -> str:
    return PurePosixPath(name.replace("\\", "/")).suffix.lower()[:20]


def _last(name: str) -> str:
    return _shown(name.replace("\\", "/").rsplit("/", 1)[-1])


def _shown(name: str) -> str:
    """Return a name without control characters, of at most 100 characters."""
    return re.sub(r"[\x00-\x1f\x7f]", "?", name)[:100] or "a file without a name"
