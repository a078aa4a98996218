"""Test what the start page does with kept edits: pictures, names, copies, deleting, and samples without an edit."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from app_page import Page

from dfd.app.options import SessionOptions
from dfd.app.session import kept_edits
from dfd.app.web.launch import RunningApp

PICTURE = "data:image/jpeg;base64,QUJDRA=="


@pytest.fixture
def edited(static: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Page]:
    """Return a page with a sample that has one handle; its edit is stored."""
    monkeypatch.setenv("DFD_DATA", str(tmp_path))
    running = RunningApp(SessionOptions(), static=static)
    running.start()
    page = Page(running)
    page.open()
    page.ask("open_sample", name="chair")
    page.alive()
    page.hold(5, translation=[0, -0.3, 0])
    page.until(lambda each: each["type"] == "saved" and each["saved"])
    yield page
    page.close()
    running.stop()


def recent(page: Page, request: str = "close_mesh", **fields: Any) -> list[dict[str, Any]]:
    """Send a request that shows the start page, and return the list of recent shapes."""
    assert page.ask(request, **fields)["type"] == "done"
    found: list[dict[str, Any]] = page.last("start")["recent"]
    return found


@pytest.mark.processes
def test_a_kept_edit_has_a_picture_and_can_be_renamed_copied_and_deleted(edited: Page) -> None:
    page = edited
    assert page.ask("keep_picture", picture=PICTURE)["type"] == "done"
    assert page.ask("keep_picture", picture="data:text/html;base64,QUJDRA==")["type"] == "failure"
    (own,) = recent(page)
    assert (own["name"], own["handles"], own["picture"]) == ("chair", 1, PICTURE)
    (own,) = recent(page, "change_kept", how="rename", key=own["key"], name="throne")
    assert (own["name"], own["present"]) == ("throne", True)
    copies = recent(page, "change_kept", how="duplicate", key=own["key"])
    assert {each["name"] for each in copies} == {"throne", "throne copy"}
    copy = next(each for each in copies if each["name"] == "throne copy")
    assert copy["picture"] == PICTURE
    page.ask("open_recent", key=copy["key"])
    state = page.alive()
    assert state["handles"][0]["translation"] == [0, -0.3, 0]
    page.ask("close_mesh")
    (left,) = recent(page, "change_kept", how="delete", key=copy["key"])
    assert left["key"] == own["key"]
    assert len(recent(page, "change_kept", how="restore", key=copy["key"])) == 2
    recent(page, "change_kept", how="delete", key=copy["key"])
    assert page.ask("change_kept", how="restore", key=own["key"])["type"] == "failure", "it is not deleted"
    assert page.ask("change_kept", how="delete", key="../../etc")["type"] == "failure"


@pytest.mark.processes
def test_an_open_edit_is_not_deleted_and_a_deleted_one_is_gone_after_an_hour(
    edited: Page, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    page = edited
    key = page.last("saved")["key"]
    monkeypatch.setattr(kept_edits, "LEAVES", 0.05)
    with pytest.raises(ValueError, match="open in another tab"):
        kept_edits.delete_kept(key)
    assert page.ask("start_fresh")["type"] == "done"
    page.until(lambda each: each["type"] == "saved" and each["saved"])
    page.ask("go", by=-1)
    page.until(lambda each: each["type"] == "saved" and each["saved"])
    first, second = recent(page)
    monkeypatch.setattr(kept_edits, "RESTORABLE", -1.0)
    recent(page, "change_kept", how="delete", key=first["key"])
    recent(page, "change_kept", how="delete", key=second["key"])
    assert page.ask("change_kept", how="restore", key=first["key"])["type"] == "failure"
    assert [each.name for each in (tmp_path / "edits").glob("*.deleted")] == [f"{second['key']}.deleted"]
