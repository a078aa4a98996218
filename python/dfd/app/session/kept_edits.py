"""Keep the edit of each mesh in the user's data folder, so that closing a session or its program loses nothing.

The edit of a mesh is the edit file `edits/KEY.json` in the data folder (`dfd.common.files.data_directory`). KEY is the
mesh's content hash. Its name for lists is in `KEY.name`, its picture in `KEY.picture`, and its marks in `KEY.marks`. A
session locks the file while the mesh is open. If another session has the mesh open, a session starts with a copy of its
edit, and keeps the copy under the key HASH-2, HASH-3 and so on.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path

from filelock import FileLock, Timeout

from dfd.app.session.marks import marks_text, with_marks
from dfd.common.files import data_directory, write_file
from dfd.editing.edit import Edit
from dfd.editing.edit_file import MadeOn, read_edit, write_edit
from dfd.mesh.mesh import Mesh

KEY = re.compile(r"[0-9a-f]{16,64}(-\d{1,6})?")
LONGEST_UNSAVED = 2.0  # seconds; during continuous work, an edit is stored at least this often
LEAVES = 1.0  # seconds in which a session whose tab was just closed stores and unlocks its edit
RESTORABLE = 3600.0  # seconds for which a deleted edit can be restored
DELETED = ".deleted"  # ending of the file of a deleted edit
BESIDE = (".name", ".picture", ".marks")  # endings of the files beside an edit
LIMIT = 2 << 30  # largest total size of the stored mesh files in bytes; above it, those of the oldest edits are removed


@dataclass(frozen=True)
class RecentEdit:
    """A kept edit in the list of recent shapes. `mesh` and `field` are files, or None if they are gone."""

    key: str
    name: str
    seconds: float  # time of the last change, since 1970
    handles: int
    mesh: Path | None
    field: Path | None
    source: str  # the name of the sample, or of the mesh file as the user opened it
    picture: str | None  # a data: URL


class KeptEdit:
    """The kept edit of one mesh, locked for one session.

    `made_on` names the files of the shape. Files in folders of `uploads` are copied, because they are deleted later.
    With a `key`, the session continues that kept edit if the mesh is still the same. If the mesh has changed and has no
    edit of its own, the session starts with the edit of `key`.

    Raises OSError if the data folder cannot be written.
    """

    def __init__(self, mesh: Mesh, made_on: MadeOn, *, uploads: Path | None = None, key: str | None = None) -> None:
        self._mesh, self.made_on, self._uploads = mesh, made_on, uploads
        self._saved: Edit | None = None  # the edit that was stored last, or that could not be stored
        self._since: float | None = None  # time of the first change since then
        own = mesh.content_hash
        first = key if key is not None and key.partition("-")[0] == own else own
        _folder().mkdir(parents=True, exist_ok=True)
        self.is_copy = not self._lock(first)
        if self.is_copy:
            self._lock_free()
        other = None if key is None or _file(first).exists() else key
        self._start = _file(first if other is None else other)
        self._stamp: tuple[int, int] | None = None  # time and size of the file that was read or written last

    def _lock(self, key: str) -> bool:
        """Lock the kept edit `key`; return False if another session has locked it."""
        lock = _locked(key)
        if lock is not None:
            self._locked, self.key = lock, key
        return lock is not None

    def _lock_free(self) -> None:
        """Lock the first key of this mesh that has no file and that no session has locked."""
        next(key for key in _free(self._mesh.content_hash) if self._lock(key))

    @property
    def path(self) -> Path:
        """Return the path of the edit file, which may not exist yet."""
        return _file(self.key)

    def read(self) -> Edit | None:
        """Return the edit with which the session starts, or None if the mesh has no kept edit.

        Raises ValueError if the file is damaged; then it is renamed, so that it is not overwritten.
        """
        try:
            edit = read_edit(self._start, self._mesh)
        except FileNotFoundError:
            return None
        except ValueError as error:
            aside = self._start.with_name(f"{self._start.name}.damaged")
            with suppress(OSError):
                self._start.replace(aside)
            reason = str(error).removeprefix(f"{self._start}: ")
            raise ValueError(f"The kept edit cannot be read, and is now in the file {aside.name}: {reason}") from error
        self._stamp = self._state()
        return with_marks(edit, _text(self._start.with_suffix(".marks")) or "")

    def begin(self, edit: Edit) -> None:
        """Take `edit` as the first state, which needs not be stored."""
        self._saved, self._since = edit, None

    def changed(self, edit: Edit) -> bool:
        """Return whether `edit` is not the one that was stored last."""
        new = edit is not self._saved
        if new:
            self._since = self._since or time.monotonic()
        return new

    @property
    def overdue(self) -> bool:
        """Return whether a change is older than `LONGEST_UNSAVED`."""
        return self._since is not None and time.monotonic() - self._since > LONGEST_UNSAVED

    def save(self, edit: Edit) -> bool:
        """Store `edit` atomically if it has changed. Return whether it was stored.

        Raises OSError if it cannot be stored; the file then stays unchanged until the next change of the edit.
        """
        if not self._locked.is_locked or edit is self._saved:
            return False
        self._saved, self._since = edit, None
        made_on = self.made_on
        try:
            stored = {name: self._stored(getattr(made_on, name)) for name in ("mesh", "field")}
            write_edit(self.path, edit, self._mesh, made_on=replace(made_on, **stored))
            write_file(self.path.with_suffix(".marks"), marks_text(edit))
        except OSError as error:
            raise OSError(f"Your edit could not be stored: {os.strerror(error.errno or 0)}") from error
        self._start, self._stamp = self.path, self._state()
        return True

    def set_aside(self, *, move: bool = False) -> None:
        """Keep the stored edit, if there is one, also under another key, because another edit will replace it.

        With `move`, nothing stays under the present key.
        """
        if self.path.exists():
            _copy(self.key, next(_free(self.key)))
            if move:
                for ending in (".json", *BESIDE):
                    self.path.with_suffix(ending).unlink(missing_ok=True)

    def keep_picture(self, picture: str) -> None:
        """Store a small picture of the edit, a data: URL."""
        if self._locked.is_locked and self.path.exists():
            write_file(self.path.with_suffix(".picture"), picture)

    def _stored(self, path: str | None) -> str | None:
        """Return a path at which a file of the shape stays. The files of an upload are copied beside the edit."""
        if path is None or self._uploads is None or not Path(path).is_relative_to(self._uploads):
            return path
        upload, *rest = Path(path).relative_to(self._uploads).parts
        copy = self.path.with_suffix("") / upload
        if not copy.exists():
            unfinished = copy.with_name(f".{upload}")
            shutil.copytree(self._uploads / upload, unfinished, copy_function=_link_or_copy, dirs_exist_ok=True)
            unfinished.replace(copy)
            _clean(self.path.with_suffix(""))
        return str(copy.joinpath(*rest))

    def release(self) -> None:
        """Unlock the edit for other sessions."""
        self._locked.release()

    def resume(self) -> Edit | None:
        """Lock the edit again after `release`. Return its state if another session has changed it meanwhile.

        If another session has locked it, this session goes on with a copy.
        """
        if self._locked.is_locked:
            return None
        if not self._lock(self.key):
            self._lock_free()
            self.is_copy, self._saved, self._stamp = True, None, None
        elif self._stamp is not None and self._state() not in (None, self._stamp):
            return self.read()
        return None

    def _state(self) -> tuple[int, int] | None:
        try:
            found = self.path.stat()
        except FileNotFoundError:
            return None
        return found.st_mtime_ns, found.st_size


def recent_edits(most: int) -> list[RecentEdit]:
    """Return at most `most` kept edits, the last changed first. Damaged files are left out."""
    return list(islice(filter(None, map(_recent, _by_age())), most))


def find_recent(key: str) -> RecentEdit:
    """Return the kept edit `key`. Raises ValueError if there is none."""
    found = _recent(_file(key)) if KEY.fullmatch(key) else None
    if found is None:
        raise ValueError("This edit is no longer kept")
    return found


def rename_kept(key: str, name: str) -> None:
    """Give a kept edit a name for the list of recent shapes. Raises ValueError if there is no such edit."""
    find_recent(key)
    write_file(_file(key).with_suffix(".name"), name)


def duplicate_kept(key: str) -> None:
    """Copy a kept edit, with its stored mesh files. Raises ValueError if there is no such edit."""
    found, copy = find_recent(key), next(_free(key))
    _copy(key, copy)
    rename_kept(copy, f"{found.name} copy")


def delete_kept(key: str) -> None:
    """Remove a kept edit from the list. `restore_kept` brings it back within `RESTORABLE` seconds.

    Raises ValueError if there is no such edit, or it is open.
    """
    find_recent(key)
    lock = _locked(key)
    if lock is None:
        raise ValueError("This edit is open in another tab: close it there first")
    try:
        for old in _folder().glob(f"*{DELETED}"):
            if time.time() - old.stat().st_ctime > RESTORABLE:
                for ending in (DELETED, *BESIDE):
                    old.with_suffix(ending).unlink(missing_ok=True)
                shutil.rmtree(old.with_suffix(""), ignore_errors=True)
        _file(key).replace(_file(key).with_suffix(DELETED))
    finally:
        lock.release()


def restore_kept(key: str) -> None:
    """Bring back an edit that `delete_kept` removed. Raises ValueError if it is gone."""
    path = _file(key)
    if not KEY.fullmatch(key) or not path.with_suffix(DELETED).is_file() or path.exists():
        raise ValueError("This edit is no longer kept")
    path.with_suffix(DELETED).replace(path)


def _file(key: str) -> Path:
    return _folder() / f"{key}.json"


def _locked(key: str) -> FileLock | None:
    """Return the lock of a kept edit, or None if another session has locked the edit."""
    lock = FileLock(_folder() / f".{key}.lock")
    with suppress(Timeout):
        lock.acquire(timeout=LEAVES, poll_interval=0.02)
        return lock
    return None


def _free(key: str) -> Iterator[str]:
    """Yield the keys of copies, of the mesh of the edit `key`, that have no file."""
    own = key.partition("-")[0]
    return (copy for number in count(2) if not _file(copy := f"{own}-{number}").exists())


def _copy(key: str, other: str) -> None:
    """Copy a kept edit, the files beside it, and its stored files."""
    stored = _folder() / key
    if stored.is_dir():
        shutil.copytree(stored, _folder() / other, copy_function=_link_or_copy, dirs_exist_ok=True)
    document = json.loads(_file(key).read_text(encoding="utf-8"))
    for name in ("mesh", "field"):
        path = document["made_on"][name]
        if path is not None and path.startswith(f"{key}/"):
            document["made_on"][name] = f"{other}/{path.removeprefix(f'{key}/')}"
    for ending in BESIDE:
        with suppress(FileNotFoundError):
            shutil.copy2(_file(key).with_suffix(ending), _file(other).with_suffix(ending))
    write_file(_file(other), json.dumps(document, indent=2, ensure_ascii=False) + "\n")


def _recent(path: Path) -> RecentEdit | None:
    """Return the kept edit in a file, or None if the file is damaged or gone."""
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        document = json.loads(path.read_text(encoding="utf-8"))
        made_on, key = document["made_on"], path.stem
        files = (path.parent / made_on[key] if made_on[key] else None for key in ("mesh", "field"))
        mesh, field = (file if file is not None and file.is_file() else None for file in files)
        source, handles = str(made_on["name"] or "mesh"), len(document["handles"])
        name, picture = _text(path.with_suffix(".name")), _text(path.with_suffix(".picture"))
        return RecentEdit(key, name or source, path.stat().st_mtime, handles, mesh, field, source, picture)
    return None


def _text(path: Path) -> str | None:
    with suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8")
    return None


def _by_age() -> list[Path]:
    """Return the files of all kept edits, the last changed first."""
    aged = []
    for path in _folder().glob("*.json"):
        with suppress(OSError):  # another process removed the file
            aged.append((path.stat().st_mtime, path))
    return [path for _, path in sorted(aged, reverse=True)]


def _clean(newest: Path) -> None:
    """Remove the stored mesh files of the oldest edits beyond `LIMIT`, but never those in the folder `newest`."""
    total = 0
    for stored in (newest, *(each for path in _by_age() if (each := path.with_suffix("")) != newest)):
        with suppress(OSError):
            total += sum(each.stat().st_size for each in stored.rglob("*") if each.is_file())
        if total > LIMIT and stored != newest:
            shutil.rmtree(stored, ignore_errors=True)


def _link_or_copy(source: str, target: str) -> None:
    """Make a hard link, which needs no space, or copy the file if its file system allows no link."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def upload_folder(path: Path) -> Path | None:
    """Return the stored folder of the upload to which the file `path` belongs; None for all other files."""
    if not path.is_relative_to(_folder()):
        return None
    steps = path.relative_to(_folder()).parts
    return _folder().joinpath(*steps[:2]) if len(steps) > 2 else None


def _folder() -> Path:
    return data_directory() / "edits"
