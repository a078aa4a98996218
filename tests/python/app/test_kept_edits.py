"""Test that edits are kept on disk: after the tab is closed, another file is opened, or the server is stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from app_page import Page, Shape
from test_sessions import leave, session_of

import dfd
from dfd.app.options import OpenedFile, SessionOptions
from dfd.app.session import kept_edits
from dfd.app.session import session as session_module
from dfd.app.web.launch import RunningApp
from dfd.editing.edit_file import read_edit

POSE = {"name": "up", "seconds": 1.0, "transforms": [{"handle": 1, "translation": [0, 1, 0]}]}


@pytest.fixture
def served(options: SessionOptions, static: Path, data: Path) -> Iterator[Callable[..., RunningApp]]:
    """Return a function that starts a server; `changed` are options. All servers share an empty data folder."""
    running: list[RunningApp] = []

    def serve(**changed: Any) -> RunningApp:
        running.append(RunningApp(replace(options, **changed), static=static))
        running[-1].start()
        return running[-1]

    yield serve
    for each in running:
        each.stop()


def opened(app: RunningApp, **how: Any) -> Page:
    """Return a new page whose shape has a field."""
    page = Page(app, **how)
    page.open()
    page.alive()
    return page


def saved(page: Page) -> str:
    """Wait until the edit is stored, and return its key."""
    return str(page.until(lambda message: message["type"] == "saved" and message["saved"])["key"])


def test_an_edit_is_there_after_the_server_was_stopped_and_started(
    served: Callable[..., RunningApp], data: Path, shape: Shape
) -> None:
    app = served()
    page = opened(app)
    assert not page.last("state")["step"], "a plane of symmetry that was found is no step"
    page.hold(5, translation=[0, -0.3, 0])
    page.ask("set_poses", poses=[POSE])
    page.ask("set_marks", marks=[{"vertex": 80, "target": None}], fit=False)
    key = saved(page)
    mesh = dfd.load(shape.mesh)
    edit = read_edit(data / "edits" / f"{key}.json", mesh)
    assert key == mesh.content_hash
    assert [each.transform.translation for each in edit.handles] == [(0, -0.3, 0)]
    assert [each.name for each in edit.poses] == ["up"]
    marks = page.last("state")["marks"]
    page.say("add", at=40)
    page.close()
    app.stop()
    again = opened(served())
    state = again.last("state")
    assert [each["vertex"] for each in state["handles"]] == [5, 40], "the newest step was stored when the server ended"
    assert state["poses"][0]["name"] == "up"
    assert [mark["target"] for mark in state["marks"]] == [mark["target"] for mark in marks] != []
    assert not state["step"], "undo begins with the first step of this session"
    again.close()


def test_a_closed_tab_is_continued_with_its_undo(served: Callable[..., RunningApp]) -> None:
    app = served()
    page = opened(app)
    page.hold(5)
    leave(page)
    other = Page(app)
    other.open()
    assert other.session == page.session
    assert other.alive()["step"]
    other.close()


def test_a_second_tab_opens_a_copy_and_says_so(served: Callable[..., RunningApp], data: Path) -> None:
    app = served()
    page = opened(app)
    page.hold(5, translation=[0, -0.3, 0])
    key = saved(page)
    other = opened(app)
    assert other.last("mesh")["warnings"][0] == session_module.COPY
    assert [each["vertex"] for each in other.last("state")["handles"]] == [5]
    assert not list(data.glob("edits/*-2.json")), "a copy without a change is not stored"
    other.hold(40)
    assert saved(other) == f"{key}-2"
    page.hold(80)
    assert saved(page) == key
    page.close()
    other.close()
    app.stop()
    third = opened(served())
    assert [each["vertex"] for each in third.last("state")["handles"]] == [5, 80]
    assert third.last("mesh")["warnings"] == []
    third.close()


def test_a_mesh_whose_tab_was_closed_is_no_copy(
    served: Callable[..., RunningApp], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_edits, "LEAVES", 60.0)  # a busy machine stores an edit slowly
    app = served()
    page = opened(app)
    page.hold(5)
    leave(page)
    other = opened(app, session="unknown")
    assert other.last("mesh")["warnings"] == []
    other.hold(40)
    saved(other)
    leave(other)
    assert page.resumes()
    state = page.alive()
    assert [each["vertex"] for each in state["handles"]] == [5, 40], "the session continues with what the other did"
    assert state["step"]
    page.close()


def test_closed_shapes_and_replaced_shapes_are_recent(
    served: Callable[..., RunningApp], shape: Shape, data: Path
) -> None:
    app = served(mesh=None, field=None)
    page = Page(app)
    page.open()
    assert page.until(lambda message: message["type"] == "start")["recent"] == []
    other = dfd.load(shape.mesh)
    moved = dfd.Mesh(other.vertices + [0, 0.001, 0], other.faces)
    moved.save(data.parent / "other.glb")
    field = shape.field.read_bytes()
    page.upload({"mine.glb": shape.mesh.read_bytes(), "mine.safetensors": field})
    page.alive()
    page.hold(5, translation=[0, -0.3, 0])
    page.upload({"other.glb": (data.parent / "other.glb").read_bytes(), "own.safetensors": field})
    page.until(lambda message: message["type"] == "mesh")
    page.alive()
    page.hold(40)
    page.ask("close_mesh")
    recent = page.last("start")["recent"]
    assert [(each["name"], each["handles"], each["present"]) for each in recent] == [
        ("other.glb", 1, True),
        ("mine.glb", 1, True),
    ]
    page.say("open_recent", key=recent[1]["key"])
    state = page.alive()
    assert page.last("mesh")["name"] == "mine.glb"
    assert state["field"]["origin"] == "file", "the field that was uploaded is kept too"
    assert [each["translation"] for each in state["handles"]] == [[0, -0.3, 0]]
    assert page.ask("open_recent", key="../../etc/passwd")["type"] == "failure"
    page.close()
    app.stop()
    # A page that was open while the server was restarted goes on with the same shape.
    page.app = served(mesh=None, field=None)
    page.kept = recent[1]["key"]
    page.open()
    assert [each["vertex"] for each in page.alive()["handles"]] == [5]
    page.close()


def test_a_mesh_that_is_gone_can_not_be_opened_again(
    served: Callable[..., RunningApp], shape: Shape, data: Path
) -> None:
    path = data.parent / "gone.glb"
    path.write_bytes(shape.mesh.read_bytes())
    page = opened(served(mesh=OpenedFile("gone.glb", path)))
    page.hold(5)
    saved(page)
    path.unlink()
    page.ask("close_mesh")
    (recent,) = page.last("start")["recent"]
    assert not recent["present"]
    assert "gone.glb is gone" in page.ask("open_recent", key=recent["key"])["message"]
    page.close()


def test_an_edit_that_is_given_is_a_step_after_the_kept_one(served: Callable[..., RunningApp], data: Path) -> None:
    page = opened(served())
    page.hold(5)
    key = saved(page)
    given = data.parent / "given.json"
    given.write_text('{"format": "dfd-edit", "version": 1, "handles": [{"vertex": 80}]}')
    page.close()
    page.app.stop()
    other = Page(served(edit=OpenedFile("given.json", given)))
    other.open()
    state = other.until(lambda message: message["type"] == "state" and message["step"])
    assert [each["vertex"] for each in state["handles"]] == [80]
    saved(other)
    assert '"vertex": 5' in (data / "edits" / f"{key}-2.json").read_text(), "the edit that was replaced is kept too"
    other.ask("go", by=-1)
    assert [each["vertex"] for each in other.last("state")["handles"]] == [5]
    other.close()


def test_a_damaged_file_is_said_and_not_overwritten(served: Callable[..., RunningApp], data: Path) -> None:
    page = opened(served())
    page.hold(5)
    path = data / "edits" / f"{saved(page)}.json"
    page.close()
    page.app.stop()
    path.write_text("{")
    other = opened(served())
    (failure,) = [message for message in other.heard if message["type"] == "failure"]
    assert "The kept edit cannot be read" in failure["message"]
    assert str(data) not in failure["message"], "no place of this machine"
    other.hold(40)
    saved(other)
    assert path.with_name(f"{path.name}.damaged").read_text() == "{"
    other.close()


def test_a_folder_that_cannot_be_written_is_said_once(served: Callable[..., RunningApp], data: Path) -> None:
    page = opened(served())
    folder = data / "edits"
    for each in folder.iterdir():
        each.unlink()
    folder.rmdir()
    folder.write_text("")
    page.hold(5)
    page.until(lambda message: message["type"] == "failure" and "could not be stored" in message["message"])
    time.sleep(0.5)
    page.ask("go", by=-1)
    assert sum(message["type"] == "failure" for message in page.heard) <= 2, "once for each change"
    assert all(not message["saved"] for message in page.heard if message["type"] == "saved")
    folder.unlink()
    page.close()


def test_work_without_a_pause_is_stored_meanwhile(
    served: Callable[..., RunningApp], monkeypatch: pytest.MonkeyPatch
) -> None:
    page = opened(served())
    monkeypatch.setattr(kept_edits, "LONGEST_UNSAVED", 0.0)
    tab = session_of(page)
    monkeypatch.setattr(tab, "run_deferred", lambda: None)  # no pause between requests
    page.hold(5)
    page.ask("fix", at=90)
    assert page.last("saved")["saved"]
    page.close()
