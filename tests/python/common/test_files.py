"""Tests of atomic writes: after an error, the old file is unchanged and no temporary file is left."""

import os
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from dfd.common.files import atomic_write, cache_directory, write_file


def test_a_file_is_replaced_and_keeps_its_mode(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("old")
    path.chmod(0o640)
    write_file(path, "new")
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert [each.name for each in tmp_path.iterdir()] == ["notes.txt"]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("old")

    def fail():
        with atomic_write(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert [each.name for each in tmp_path.iterdir()] == ["notes.txt"]


def test_a_symbolic_link_stays_one(tmp_path):
    real = tmp_path / "elsewhere" / "real.txt"
    real.parent.mkdir()
    real.write_text("old")
    link, dangling = tmp_path / "link.txt", tmp_path / "dangling.txt"
    link.symlink_to(real)
    dangling.symlink_to("elsewhere/later.txt")
    write_file(link, "new")
    write_file(dangling, "made")
    assert (link.is_symlink(), real.read_text()) == (True, "new")
    assert (dangling.is_symlink(), (tmp_path / "elsewhere" / "later.txt").read_text()) == (True, "made")
    around = tmp_path / "around"
    around.symlink_to(around)
    with pytest.raises(OSError, match="around could not be written: Too many levels"):
        write_file(around, "new")


def test_pipes_devices_and_folders_are_refused(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    link = tmp_path / "null"
    link.symlink_to("/dev/null")
    for path in (pipe, link, Path("/dev/null")):
        with pytest.raises(OSError, match="must be a regular file, got"):
            write_file(path, "new")
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    with pytest.raises(IsADirectoryError, match="is a folder, not a file"):
        write_file(tmp_path, "new")
    with pytest.raises(FileNotFoundError, match="the folder .*absent does not exist"):
        write_file(tmp_path / "absent" / "notes.txt", "new")


def test_a_later_write_deletes_the_old_temporary_file_of_a_killed_process(tmp_path):
    path = tmp_path / "notes.txt"
    program = """
import os, signal, sys
from dfd.common.files import atomic_write, cache_directory
with atomic_write(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", program, str(path)], timeout=60)
    assert done.returncode == -signal.SIGKILL
    (leftover,) = tmp_path.iterdir()
    write_file(path, "new")
    assert leftover.exists()  # a young file is kept, because another process may still write to it
    os.utime(leftover, (0, 0))
    write_file(path, "new")
    assert [each.name for each in tmp_path.iterdir()] == ["notes.txt"]


def test_concurrent_writers_have_separate_temporary_files(tmp_path):
    path = tmp_path / "notes.txt"
    with atomic_write(path) as first:
        first.write_text("first")
        write_file(path, "second")
        assert first.read_text() == "first"
    assert path.read_text() == "first"
    failed: list[BaseException] = []

    def write_often(content):
        try:
            for _ in range(30):
                write_file(path, content)
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=write_often, args=(chr(97 + n) * 1000,)) for n in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    assert len(set(path.read_text())) == 1
    assert [each.name for each in tmp_path.iterdir()] == ["notes.txt"]


def test_an_environment_variable_sets_the_cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    assert cache_directory() == tmp_path / "cache"
    monkeypatch.setenv("DFD_CACHE", "~/somewhere")
    assert cache_directory() == Path.home() / "somewhere"
