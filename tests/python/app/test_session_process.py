"""What the process of a session does: its loop, and what it leaves when it is killed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dfd.app.web.worker import Loop


class Stub:
    """A session with pending columns; `did` is what it did, in order."""

    def __init__(self, loop: Loop, pending: int) -> None:
        self.loop, self.pending, self.did = loop, pending, list[str]()

    @property
    def has_pending_columns(self) -> bool:
        return self.pending > 0

    def send_pending_columns(self) -> None:
        self.pending -= 1
        self.did.append("send")
        self.loop.order("click")

    def click(self) -> None:
        self.did.append("click")

    def rest(self) -> None:
        self.did.append("rest")
        self.loop.end()

    def end(self) -> None:
        self.did.append("end")

    def guarded(self, number: int, work: Callable[[], None]) -> None:
        work()


def test_a_click_waits_for_the_instances_of_one_column_at_most_and_saving_comes_last() -> None:
    loop = Loop()
    session: Any = Stub(loop, pending=2)
    for _ in range(3):
        loop.order("click")
    loop.run(session)
    assert session.did == [*["click"] * 3, "send", "click", "send", "click", "rest", "end"]


KILLED_WHILE_SAVING = """
import os, random, signal, sys, time
from pathlib import Path
import dfd
from dfd.app.options import OpenedFile, Source
from dfd.app.protocol.parts import KeyPose
from dfd.app.session.autosave import Autosave, Saved
from dfd.editing.edit_file import read_edit
from made_field import field_of
from mesh_files import CORNERS, CUBE

folder = Path(sys.argv[1])
mesh = dfd.Mesh(CORNERS, CUBE)
session = dfd.Deformer(mesh, field_of(mesh))
session.add(0, name="x" * 20_000)
moved = []
for k in range(2):
    session.move(1, translation=(0, k, 0))
    moved.append(session.edit)
source = Source(name="cube", path=folder / "cube.obj")
opened = [Saved(source=source), Saved(source=source, field=OpenedFile(name="x" * 20_000, path=folder / "field"))]
poses = [(KeyPose(name="long " * n, seconds=0, transforms=()),) * 20 for n in (1, 200)]
autosave = Autosave(folder)
random.seed(0)

def save(k):
    autosave.save_opened(opened[k])
    autosave.save_edit(moved[k], mesh)
    autosave.save_poses(poses[k])

save(0)
for _ in range(30):
    child = os.fork()
    while child == 0:
        save(0)
        save(1)
    time.sleep(random.uniform(0, 0.02))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    assert autosave.saved() in opened and autosave.poses() in poses
    assert read_edit(autosave.edit, mesh).handles in [edit.handles for edit in moved]
save(0)
print(sorted(path.name for path in folder.iterdir()))
"""


@pytest.mark.processes
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_a_session_killed_while_it_saves_leaves_whole_files(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    arguments = [sys.executable, "-W", "ignore", "-c", KILLED_WHILE_SAVING, str(tmp_path)]
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "['edit.json', 'poses.json', 'session.json']\n", "nothing half is left lying about"
