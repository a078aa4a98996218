"""The folder of a server's sessions. The next server deletes it if its server was killed."""

import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from filelock import FileLock, Timeout

PREFIX = "dfd-app-"
LOCK = ".running"  # this file is locked while the server runs; the system unlocks it when the process ends


class TemporaryFolder:
    """A new folder in the system's folder for temporary files, locked until `cleanup` deletes it.

    First, the folders of servers that were killed are deleted.
    """

    def __init__(self) -> None:
        for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*/{LOCK}"):
            with suppress(Timeout, OSError):  # the server runs, or belongs to another user
                with FileLock(path, timeout=0):
                    pass
                shutil.rmtree(path.parent, ignore_errors=True)
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = FileLock(self.path / LOCK)
        self._lock.acquire()

    def cleanup(self) -> None:
        """Delete the folder."""
        self._lock.release()
        shutil.rmtree(self.path, ignore_errors=True)
