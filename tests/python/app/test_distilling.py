"""Test the search for a field and its distillation while the page shows the mesh: progress, cancelling, continuing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from app_page import Page, Shape

from dfd.app.options import OpenedFile, SessionOptions
from dfd.app.session import preparation
from dfd.app.web.launch import RunningApp
from dfd.field.field import Field


@pytest.fixture
def bare(shape: Shape, static: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningApp]:
    """Return a server without a field for its mesh, and with an empty cache."""
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    source = OpenedFile(name="chair.glb", path=shape.mesh)
    running = RunningApp(SessionOptions(mesh=source, encoder=str(shape.encoder), distill=shape.settings), static=static)
    running.start()
    yield running
    running.stop()


@pytest.mark.processes
def test_the_preset_is_that_of_the_field_and_of_the_session(
    shape: Shape, static: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    source = OpenedFile(name="chair.glb", path=shape.mesh)
    start = SessionOptions(mesh=source, encoder=str(shape.encoder), preset="paper", distill=shape.settings)
    running = RunningApp(start, static=static)
    running.start()
    page = Page(running)
    page.open()
    assert page.alive()["preset"] == "paper"
    page.close()
    running.stop()
    (made,) = (tmp_path / "cache" / "fields").glob("*.safetensors")
    assert Field.load(made).settings["preset"] == "paper"


@pytest.mark.processes
def test_the_mesh_is_shown_at_once_and_comes_alive(bare: RunningApp) -> None:
    page = Page(bare)
    page.open()
    state = page.alive()
    assert state["field"]["origin"] == "distilled"
    kinds = [message["type"] for message in page.heard]
    assert kinds.index("mesh") < kinds.index("progress", kinds.index("mesh"))
    told = [message for message in page.heard if message["type"] == "progress" and message["task"] == "distill"]
    stages = list(dict.fromkeys(message["stage"] for message in told))
    assert stages == [stage for stage in ("read", "load", "render", "encode", "fit") if stage in stages]
    assert {"render", "encode", "fit"} <= set(stages)
    assert any(message["total"] and message["done"] == message["total"] for message in told)
    assert all(message["seconds_left"] is None or message["seconds_left"] >= 0 for message in told)
    assert page.ask("add", at=5)["type"] == "done"

    other = Page(bare)
    other.open()
    assert other.alive()["field"]["origin"] == "cache"
    assert all(message["type"] != "progress" or message["task"] != "distill" for message in other.heard)
    page.close()
    other.close()


@pytest.mark.processes
def test_a_distillation_can_be_stopped_and_begun_again(shape: Shape, static: Path) -> None:
    long = {**shape.settings, "steps": 200_000, "cache": False}
    options = SessionOptions(mesh=OpenedFile(name="c", path=shape.mesh), encoder=str(shape.encoder), distill=long)
    running = RunningApp(options, static=static)
    running.start()
    try:
        page = Page(running)
        page.open()
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "fit")
        assert page.ask("add", at=5)["type"] == "failure"
        page.say("cancel")
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "cancelled")
        assert page.until(lambda message: message["type"] == "state")["field"]["status"] == "none"
        page.say("distill")
        assert page.until(lambda message: message["type"] == "state")["field"]["status"] == "distilling"
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "fit")
        page.close()
    finally:
        running.stop()


@pytest.mark.processes
def test_an_encoder_that_is_not_there_is_said(shape: Shape, static: Path, tmp_path: Path) -> None:
    options = SessionOptions(mesh=OpenedFile(name="c", path=shape.mesh), encoder=str(tmp_path / "nothing"))
    running = RunningApp(options, static=static)
    running.start()
    try:
        page = Page(running)
        page.open()
        failure = page.until(lambda message: message["type"] == "failure")
        assert "nothing" in failure["message"]
        assert page.ask("add", at=5)["type"] == "failure"
        page.close()
    finally:
        running.stop()


def test_a_process_that_is_killed_is_said(shape: Shape, tmp_path: Path) -> None:
    source, path = OpenedFile(name="c", path=shape.mesh), tmp_path / "field"
    with pytest.raises(ValueError, match="ended before it was done"):
        preparation.distill_apart(source, {}, path, lambda *_: None, lambda process: process.kill())


@pytest.mark.processes
def test_one_distillation_at_a_time(bare: RunningApp) -> None:
    """The second distillation waits until the first has ended, and can be stopped while it waits."""
    with preparation._DISTILLING:
        page = Page(bare)
        page.open()
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "wait")
        page.say("cancel")
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "cancelled")
        page.say("distill")
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "wait")
    assert page.alive()["field"]["origin"] == "distilled"
    page.close()
