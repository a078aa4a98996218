"""The folder of a server's sessions. The next server deletes it if its server was killed."""

import shutil
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from filelock import FileLock, Timeout

PREFIX = "dfd-app-"
LOCK = ".running"  # this file is locked while the server runs; the system unlocks it when the process ends
STARTING = 60.0  # seconds within which a server locks its new folder


class TemporaryFolder:
    """A new folder in the system's folder for temporary files, locked until `cleanup` deletes it.

    First, the folders of servers that were killed are deleted.
    """

    def __init__(self) -> None:
        for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
            with suppress(OSError):  # for example, the folder of another user
                _delete_if_unused(path)
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = FileLock(self.path / LOCK)
        self._lock.acquire()

    def cleanup(self) -> None:
        """Delete the folder."""
        self._lock.release()
        shutil.rmtree(self.path, ignore_errors=True)


def _delete_if_unused(path: Path) -> None:
    """Delete a folder whose server has ended. A folder without a lock may belong to a server that starts just now."""
    if path.is_symlink() or not path.is_dir():
        return
    if (path / LOCK).exists():
        lock = FileLock(path / LOCK)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            return
        lock.release()
    elif time.time() - path.stat().st_mtime <= STARTING:
        return
    shutil.rmtree(path, ignore_errors=True)
