"""A field that is found or made while the page already shows the mesh: stages, time left, cancelling, going on."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from app_page import Page, Shape

from dfd.app.options import SessionOptions, Source
from dfd.app.session.distill_process import DistillProcess
from dfd.app.session.preparation import USUAL_SECONDS, TimeLeft
from dfd.app.web.launch import RunningApp


@pytest.fixture
def bare(shape: Shape, static: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningApp]:
    """A server that has no field for its mesh, and a cache of its own."""
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    source = Source(name="chair.glb", path=shape.mesh)
    running = RunningApp(SessionOptions(mesh=source, encoder=str(shape.encoder), distill=shape.settings), static=static)
    running.start()
    yield running
    running.stop()


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
    assert page.ask("add", at={"vertex": 5})["type"] == "done"

    other = Page(bare)
    other.open()
    assert other.alive()["field"]["origin"] == "cache"
    assert all(message["type"] != "progress" or message["task"] != "distill" for message in other.heard)
    page.close()
    other.close()


@pytest.mark.processes
def test_a_distillation_can_be_stopped_and_begun_again(shape: Shape, static: Path) -> None:
    long = {**shape.settings, "steps": 200_000, "cache": False}
    options = SessionOptions(mesh=Source(name="c", path=shape.mesh), encoder=str(shape.encoder), distill=long)
    running = RunningApp(options, static=static)
    running.start()
    try:
        page = Page(running)
        page.open()
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "fit")
        assert page.ask("add", at={"vertex": 5})["type"] == "failure"
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
    options = SessionOptions(mesh=Source(name="c", path=shape.mesh), encoder=str(tmp_path / "nothing"))
    running = RunningApp(options, static=static)
    running.start()
    try:
        page = Page(running)
        page.open()
        failure = page.until(lambda message: message["type"] == "failure")
        assert "nothing" in failure["message"]
        assert page.ask("add", at={"vertex": 5})["type"] == "failure"
        page.close()
    finally:
        running.stop()


def order(shape: Shape, folder: Path) -> tuple[Source, SessionOptions, Path]:
    options = SessionOptions(encoder=str(shape.encoder), distill={**shape.settings, "cache": False})
    return Source(name="c", path=shape.mesh), options, folder


def test_a_process_that_is_killed_is_said(shape: Shape, tmp_path: Path) -> None:
    process = DistillProcess(*order(shape, tmp_path), None)
    os.kill(process._process.pid, signal.SIGKILL if sys.platform != "win32" else signal.SIGTERM)
    with pytest.raises(ValueError, match="ended before it was done"):
        process.run(lambda *_: None)


@pytest.mark.processes
def test_one_distillation_at_a_time(shape: Shape, tmp_path: Path) -> None:
    """The second waits until the first has ended, however it ends."""
    lock = tmp_path / "lock"
    first = DistillProcess(*order(shape, tmp_path / "1"), lock)
    (tmp_path / "1").mkdir()
    (tmp_path / "2").mkdir()
    heard: list[str] = []
    begun = time.monotonic()
    while not lock.exists():
        assert time.monotonic() - begun < 60
        time.sleep(0.01)
    time.sleep(0.2)
    second = DistillProcess(*order(shape, tmp_path / "2"), lock)
    first_path = first.run(lambda *_: None)
    second_path = second.run(lambda stage, *_: heard.append(stage))
    assert heard[0] == "wait"
    assert first_path is not None
    assert second_path is not None
    assert first_path.read_bytes() == second_path.read_bytes()


def test_the_time_left_falls_to_nothing() -> None:
    left, now, last = TimeLeft(), 0.0, None
    for stage, seconds in USUAL_SECONDS.items():
        for step in range(10):
            last = left.after(stage, step, 10, now + 2 * seconds * step / 10)
            assert last is not None
            assert last > 0
        now += 2 * seconds
    assert last is not None
    assert last < 1.0, "the end is near"
    assert left.after("fit", 10, 10, now) == pytest.approx(0.0)


def test_the_time_left_follows_the_machine() -> None:
    """One that takes three times the usual is told to take it to the end."""
    left, now = TimeLeft(), 0.0
    for stage in ("read", "load", "simplify", "render"):
        left.after(stage, 0, None, now)
        now += 3 * USUAL_SECONDS[stage]
    told = left.after("encode", 0, 24, now)
    assert told == pytest.approx(3 * (USUAL_SECONDS["encode"] + USUAL_SECONDS["smooth"] + USUAL_SECONDS["fit"]))
    assert left.after("a stage of another kind", 0, 1, now) is None
