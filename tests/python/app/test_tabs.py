"""Sessions of the real server outlive reloads, crashes and idleness, and know nothing of each other."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from app_page import Page

from dfd.app.options import SessionOptions
from dfd.app.web.launch import RunningApp
from dfd.app.web.link import ProcessLink
from dfd.app.web.tabs import OPENED_ELSEWHERE

pytestmark = pytest.mark.processes


def process_of(page: Page) -> int:
    assert page.session is not None
    tab = page.app.tabs.find(page.session)
    assert tab is not None
    assert isinstance(tab.link, ProcessLink)
    assert tab.link.pid is not None
    return tab.link.pid


def test_a_reload_loses_nothing(page: Page) -> None:
    handle = page.ask("add", at={"vertex": 5}, transform={"translation": [0, -0.3, 0]})["handle"]
    page.close()
    assert page.open()["resumed"]
    state = page.alive()
    assert [each["handle"] for each in state["handles"]] == [handle]
    assert state["can_undo"]
    assert page.last("mesh")["name"] == "chair.glb"
    assert page.last("columns")["columns"][0]["column"] == state["handles"][0]["column"]


def test_a_tab_that_opens_a_session_takes_it_over(page: Page) -> None:
    other = Page(page.app, session=page.session)
    assert other.open()["resumed"]
    assert page.closed_with() == OPENED_ELSEWHERE
    other.alive()
    other.close()
    page.open()


def test_tabs_know_nothing_of_each_other(page: Page) -> None:
    other = Page(page.app)
    other.open()
    other.alive()
    assert other.session != page.session
    page.ask("add", at={"vertex": 5})
    other.ask("undo")
    assert other.ask("export", format="edit")["type"] == "download"
    assert all(message["type"] != "state" or not message["handles"] for message in other.heard)
    other.close()


def test_a_session_that_is_killed_goes_on_from_what_was_saved(page: Page, new_page: Page) -> None:
    other, page = page, new_page
    page.ask("add", at={"vertex": 5}, transform={"translation": [0, -0.3, 0]})
    time.sleep(1.5)  # until it rests and saves
    os.kill(process_of(page), signal.SIGKILL)
    failure = page.until(lambda message: message["type"] == "failure")
    assert "goes on from what was saved" in failure["message"]
    state = page.until(lambda message: message["type"] == "state" and message["handles"])
    assert state["handles"][0]["translation"] == [0, -0.3, 0]
    assert other.ask("add", at={"vertex": 6})["type"] == "done"
    os.kill(process_of(page), signal.SIGKILL)
    assert "It restarts" in page.until(lambda message: message["type"] == "failure")["message"]


def test_a_process_that_ended_before_its_turn_harms_no_session(options: SessionOptions, static: Path) -> None:
    running = RunningApp(options, static=static)
    running.start()
    try:
        spare = running.tabs._spare
        assert spare is not None
        assert spare.pid is not None
        os.kill(spare.pid, signal.SIGKILL)
        page = Page(running)
        page.open()
        assert page.alive()["field"]["status"] == "ready"
        assert all(message["type"] != "failure" for message in page.heard)
        page.close()
    finally:
        running.stop()


def test_a_session_that_ended_for_idleness_comes_back(app: RunningApp, new_page: Page) -> None:
    page = new_page
    page.ask("add", at={"vertex": 5})
    page.close()
    assert page.session is not None
    tab = app.tabs.find(page.session)
    assert tab is not None
    while tab.attended:
        time.sleep(0.01)
    assert app.loop is not None
    asyncio.run_coroutine_threadsafe(app.tabs.sweep(time.monotonic() + 3600), app.loop).result(30)
    assert tab.link is None
    assert page.open()["resumed"]
    page.until(lambda message: message["type"] == "state" and message["handles"])


@pytest.fixture
def poor(options: SessionOptions, static: Path) -> Iterator[RunningApp]:
    """A server whose sessions get little memory, and open nothing by themselves."""
    running = RunningApp(
        SessionOptions(encoder=options.encoder, distill=options.distill, memory_bytes=1 << 30), static=static
    )
    running.start()
    yield running
    running.stop()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no limit of memory on this system")
def test_memory_that_runs_out_is_said_and_nothing_else(poor: RunningApp, tmp_path: Path) -> None:
    page = Page(poor)
    page.open()
    count = 12_000_000
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {count}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    points = np.random.default_rng(0).random((count, 3), np.float32)
    page.upload({"big.ply": header.encode() + points.tobytes() + b"\3" + np.arange(3, dtype=np.int32).tobytes()})
    failure = page.until(lambda message: message["type"] == "failure")
    assert "emory" in failure["message"]
    page.ask("open_sample", name="chair")
    assert page.last("mesh")["name"] == "Chair"
    page.close()
