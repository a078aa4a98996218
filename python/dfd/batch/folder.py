"""The folder of a batch. Each finished shape is a folder, which is created atomically.

    batch.json              the settings
    edits/                  edits, each with the mesh and the field that it was made on
    shapes/NAME/            the results of a shape, and record.json, which marks it as finished
    shapes/4f2/NAME/        the same in a batch of many shapes
    shapes.parquet, index.html    made from the records
    .work/                  unfinished attempts and locks; may be removed when nothing runs

An attempt writes into its own folder below `.work`, its record last, which is then renamed to the final folder. So a
shape is either finished or not started, wherever a process, the driver or the machine stops; of two attempts at one
shape the second fails to rename.
"""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
from pydantic import ValidationError

from dfd.batch.record import Record
from dfd.batch.settings import BatchSettings
from dfd.common.files import atomic_write

SETTINGS, RECORD, WORK, OWNER = "batch.json", "record.json", ".work", "owner"
EXIT_NOTE = "last-words"
TAKEN = (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR)


class BatchFolder:
    """The files and folders of a batch below `root`."""

    def __init__(self, root: str | os.PathLike[str], *, sharded: bool) -> None:
        self.root = Path(root)
        self.sharded = sharded
        self.work = self.root / WORK
        self.edits = self.root / "edits"

    @classmethod
    def begin(cls, root: str | os.PathLike[str], settings: BatchSettings) -> BatchFolder:
        """Create the folder, or resume in one that was started with the same settings.

        Raises ValueError if it holds something else, or a batch with other settings; OSError if it cannot be made or
        written.
        """
        folder = cls(root, sharded=settings.sharded)
        if folder.root.exists() and not folder.root.is_dir():
            raise NotADirectoryError(f"`--output` must be a folder, but {folder.root} is a file")
        if not folder.root.parent.is_dir():
            raise FileNotFoundError(f"`--output`: the folder {folder.root.parent} does not exist")
        before = read_settings(folder.root)
        if before is None and folder.root.is_dir() and any(folder.root.iterdir()):
            raise ValueError(f"`--output` must be a new folder or one of an earlier batch, got {folder.root}")
        if before is not None and before != settings:
            was, now = before.model_dump(), settings.model_dump()
            differ = ", ".join(f"{key} {was[key]}, now {now[key]}" for key in was if was[key] != now[key])
            raise ValueError(f"`--output`: {folder.root} was begun with other settings ({differ})")
        try:
            folder.root.mkdir(exist_ok=True)
            folder.work.mkdir(exist_ok=True)
            with atomic_write(folder.root / SETTINGS, "output") as temporary:
                temporary.write_text(settings.model_dump_json(indent=2) + "\n", "utf-8")
        except OSError as error:
            raise OSError(error.errno, f"`--output`: {root} cannot be written: {error.strerror}") from error
        return folder

    def shape(self, name: str) -> Path:
        """The folder of a finished shape."""
        shapes = self.root / "shapes"
        return shapes / hashlib.sha256(name.encode()).hexdigest()[:3] / name if self.sharded else shapes / name

    def record(self, name: str) -> Record | None:
        """The record of a shape, or None where it is not finished."""
        try:
            return Record.model_validate_json((self.shape(name) / RECORD).read_bytes())
        except (OSError, ValidationError):
            return None

    def finished(self, name: str) -> bool:
        """Whether a shape has its record."""
        return (self.shape(name) / RECORD).is_file()

    def attempt(self, name: str, token: str) -> Path:
        """The folder of one attempt."""
        return self.work / f"{name}~{token}"

    def begin_attempt(self, name: str, token: str) -> Path:
        """Make the folder of one attempt."""
        attempt = self.attempt(name, token)
        attempt.mkdir(parents=True)
        (attempt / OWNER).write_text(f"{os.getpid()} {socket.gethostname()}", "utf-8")
        return attempt

    def publish(self, attempt: Path, record: Record) -> Record:
        """Write the record, rename the attempt to the final folder, and return the record that is there now."""
        for private in (OWNER, EXIT_NOTE):
            (attempt / private).unlink(missing_ok=True)
        with atomic_write(attempt / RECORD) as temporary:
            temporary.write_text(record.model_dump_json(indent=2) + "\n", "utf-8")
        final = self.shape(record.name)
        final.parent.mkdir(parents=True, exist_ok=True)
        try:
            attempt.rename(final)
        except OSError as error:
            if error.errno not in TAKEN:
                raise
            shutil.rmtree(attempt, ignore_errors=True)
            return self.record(record.name) or record
        return record

    def retire(self, name: str) -> None:
        """Remove the results of a shape that is to be repeated."""
        with suppress(FileNotFoundError):
            away = self.attempt(name, secrets.token_hex(4))
            self.shape(name).rename(away)
            shutil.rmtree(away, ignore_errors=True)

    def clear_away(self, name: str, token: str) -> tuple[str, float]:
        """Remove the folder of an attempt that ended early.

        Returned are the note that its guard wrote before it ended the process, empty without one, and the seconds since
        it was started.
        """
        attempt, note, seconds = self.attempt(name, token), "", 0.0
        with suppress(OSError):
            seconds = max(0.0, time.time() - (attempt / OWNER).stat().st_mtime)
            note = (attempt / EXIT_NOTE).read_text("utf-8", "replace")
        shutil.rmtree(attempt, ignore_errors=True)
        return note, seconds

    def sweep(self) -> None:
        """Remove the unfinished attempts of dead processes of this machine."""
        for attempt in self.work.glob("*~*"):
            try:
                process, host = (attempt / OWNER).read_text("utf-8").split(" ", 1)
                alive = host != socket.gethostname() or psutil.pid_exists(int(process))
            except (OSError, ValueError):
                alive = False
            if not alive:
                shutil.rmtree(attempt, ignore_errors=True)

    @contextmanager
    def lock(self, rank: int, world_size: int) -> Iterator[None]:
        """Hold the folder for one driver of a rank; ValueError if another one holds it."""
        path = self.work / f"rank-{rank}-of-{world_size}.lock"
        with path.open("w") as stream:
            if sys.platform != "win32":
                import fcntl

                try:
                    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    raise ValueError(f"`--output`: another run is at work in {self.root}") from None
                except OSError:
                    pass  # a file system without locks: each shape can still be renamed only once
            yield


def read_settings(root: Path) -> BatchSettings | None:
    """The settings of the batch in `root`, or None where there is none.

    Raises ValueError if its `batch.json` is damaged or of another version.
    """
    try:
        text = (root / SETTINGS).read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    try:
        return BatchSettings.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(
            f"`--output`: {root / SETTINGS} cannot be gone on from: {'.'.join(map(str, first['loc']))}: {first['msg']}"
        ) from None
