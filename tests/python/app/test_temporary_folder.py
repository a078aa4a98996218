"""Test that the folders of servers that were killed are deleted, and no other folders."""

import tempfile
from pathlib import Path

import pytest
from filelock import FileLock

from dfd.app.web.temporary_folder import LOCK, PREFIX, TemporaryFolder


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_folder_is_deleted_after_its_server_was_killed(place: Path) -> None:
    killed, runs, other, new = (place / name for name in (f"{PREFIX}a", f"{PREFIX}b", "other", f"{PREFIX}c"))
    for folder in (killed, runs, other, new):
        folder.mkdir()
        (folder / "mesh.obj").write_text("")
    (killed / LOCK).touch()
    lock = FileLock(runs / LOCK)
    lock.acquire()
    own = TemporaryFolder()
    assert not killed.exists()
    assert all((folder / "mesh.obj").exists() for folder in (runs, other, new))
    second = TemporaryFolder()
    assert own.path.exists()
    for each in (own, second):
        each.cleanup()
        assert not each.path.exists()
    lock.release()
