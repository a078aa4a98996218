"""Test the search for a field and its distillation while the page shows the mesh: progress, cancelling, continuing."""

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from app_page import Page, Shape

import dfd
from dfd.app.options import SAMPLES, OpenedFile, SessionOptions, read_shape
from dfd.app.session import preparation
from dfd.app.session.stages import STAGES
from dfd.app.web.launch import RunningApp
from dfd.distillation.distill_apart import LESS_URGENT, distill_apart
from dfd.distillation.settings import DistillSettings
from dfd.field.field import Field


def learned(page: Page) -> dict[str, Any]:
    """Wait until the shape has a field with features, and return that state."""
    known = ("distilled", "cache")
    return page.until(lambda message: message["type"] == "state" and message["field"]["origin"] in known)


@pytest.fixture
def bare(shape: Shape, static: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningApp]:
    """Return a server without a field for its mesh, and with an empty cache."""
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("DFD_DATA", str(tmp_path / "data"))
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
    assert state["field"]["origin"] == "geometry", "parts can be grabbed before the features are learned"
    handle = page.hold(5, translation=[0, -0.3, 0])
    state = learned(page)
    assert [(each["handle"], each["translation"]) for each in state["handles"]] == [(handle, [0, -0.3, 0])]
    assert state["step"], "the edit and its history continue with the features"
    kinds = [message["type"] for message in page.heard]
    assert kinds.index("mesh") < kinds.index("progress", kinds.index("mesh"))
    told = [message for message in page.heard if message["type"] == "progress" and message["task"] == "distill"]
    stages = list(dict.fromkeys(message["stage"] for message in told))
    assert stages[1:] == [stage for stage in STAGES if stage in stages[1:]], (
        "first “Starting to learn”, then each in order"
    )
    assert {"render", "encode", "fit"} <= set(stages)
    page.until(lambda message: message["type"] == "progress" and message["stage"] == "done")
    steps = [message for message in page.heard if message["type"] == "progress" and message["share"] is not None]
    shares = [message["share"] for message in steps if message["stage"] == "encode"]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert {"Looking at the pictures", "Finding parts"} <= {
        message["text"] for message in page.heard if "text" in message
    }
    assert page.ask("add", at=40)["type"] == "done"

    other = Page(bare)
    other.open()
    assert learned(other)["field"]["origin"] == "cache"
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
        assert page.ask("distill")["type"] == "failure", "one distillation at a time"
        page.say("cancel")
        page.until(lambda message: message["type"] == "progress" and message["stage"] == "cancelled")
        assert page.until(lambda message: message["type"] == "state")["field"]["origin"] in (None, "geometry")
        page.say("distill")
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
        page.until(lambda message: message["type"] == "state" and message["field"]["origin"] == "geometry")
        assert page.ask("add", at=5)["type"] == "done", "parts of the geometry need no encoder"
        page.close()
    finally:
        running.stop()


def test_a_process_that_is_killed_is_said(shape: Shape, tmp_path: Path) -> None:
    read, path = partial(dfd.load, shape.mesh), tmp_path / "field"
    with pytest.raises(ValueError, match="ended before it was done"):
        distill_apart(read, {}, path, lambda *_: None, lambda process: process.kill())


def tell_priority() -> dfd.Mesh:
    raise ValueError(f"priority {os.nice(0)}")


def test_a_distillation_is_less_urgent_than_answers(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"priority {min(os.nice(0) + LESS_URGENT, 19)}$"):
        distill_apart(tell_priority, {}, tmp_path / "field", lambda *_: None, lambda _: None)


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
    assert learned(page)["field"]["origin"] == "distilled"
    page.close()


@pytest.mark.parametrize("name", SAMPLES)
def test_samples_ship_with_the_fields_of_todays_settings(name: str) -> None:
    path = SessionOptions().shipped_field(name)
    assert path is not None, "python -m bench.training.sample_fields makes it"
    mesh, _ = read_shape(name)
    field = dfd.Field.load(path, mesh=mesh)
    settings = DistillSettings().as_dict()
    assert not {key for key, value in settings.items() if value is not None and field.settings.get(key) != value}
    assert path.stat().st_size < 500_000


def test_other_settings_do_not_use_the_shipped_field(shape: Shape) -> None:
    assert SessionOptions(preset="paper").shipped_field("chair") is None
    assert SessionOptions(encoder=str(shape.encoder)).shipped_field("chair") is None
    assert SessionOptions(distill={"views": 4}).shipped_field("chair") is None
    assert SessionOptions().shipped_field(OpenedFile("chair", shape.mesh)) is None


def test_a_sample_needs_no_distillation(static: Path, data: Path) -> None:
    running = RunningApp(SessionOptions(mesh="robot"), static=static)
    running.start()
    page = Page(running)
    page.open()
    assert page.alive()["field"]["origin"] == "sample"
    assert not any(message["type"] == "progress" and message["task"] == "distill" for message in page.heard)
    assert page.ask("probe", vertex=5)["type"] == "heat"
    page.close()
    running.stop()


@pytest.mark.processes
def test_a_full_disk_does_not_stop_a_shape_whose_field_is_cached(
    bare: RunningApp, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Page(bare)
    first.open()
    learned(first)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Field, "save", full)
    second = Page(bare)
    second.open()
    assert learned(second)["field"]["origin"] == "cache"
    assert second.ask("add", at=5)["type"] == "done"
    for page in (first, second):
        page.close()
