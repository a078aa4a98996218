"""Test that sessions continue after reloads, are independent, and share the data of one shape."""

import time

import numpy as np
from app_page import Page

from dfd.app.options import SessionOptions
from dfd.app.session.session import Session
from dfd.app.web import server
from dfd.app.web.launch import RunningApp
from dfd.app.web.tab import OPENED_ELSEWHERE, SESSION_ENDED


def session_of(page: Page) -> Session:
    tab = page.app.sessions.find(page.session)
    return tab.session


def leave(page: Page) -> None:
    """Close the page, and wait until the server has noticed."""
    tab = page.app.sessions.find(page.session)
    page.close()
    while tab.outbox is not None:
        time.sleep(0.01)


def test_a_reload_loses_nothing(page: Page) -> None:
    handle = page.hold(5, translation=[0, -0.3, 0])
    leave(page)
    assert page.resumes()
    state = page.alive()
    assert [each["handle"] for each in state["handles"]] == [handle]
    assert state["step"]
    assert page.last("mesh")["name"] == "chair.glb"
    assert page.last("columns")["columns"] == [each["column"] for each in state["handles"][0]["columns"]]


def test_a_tab_that_opens_a_session_takes_it_over(page: Page) -> None:
    other = Page(page.app, session=page.session)
    assert other.resumes()
    assert page.closed_with() == OPENED_ELSEWHERE
    other.alive()
    other.close()
    page.open()


def test_two_tabs_have_one_shape_and_each_its_own_edit(page: Page, new_page: Page) -> None:
    assert new_page.session != page.session
    page.hold(5, translation=[0, -0.3, 0])
    new_page.ask("go", by=-1)
    assert all(message["type"] != "state" or not message["handles"] for message in new_page.heard)
    one, other = session_of(page).require().deformer, session_of(new_page).require().deformer
    assert one.features is other.features
    assert one.bound.parts is other.bound.parts
    np.testing.assert_array_equal(other.vertices, other.mesh.vertices)
    assert one.part(5) == other.part(5)


def test_of_the_sessions_that_no_page_shows_the_oldest_end(app: RunningApp, page: Page, monkeypatch: object) -> None:
    monkeypatch.setattr(server, "MOST_UNATTENDED", 1)  # type: ignore[attr-defined]
    left = [Page(app, session="unknown") for _ in range(2)]
    for each in left:
        each.open()
    folders = [session_of(each).folder for each in left]
    leave(left[1])
    leave(left[0])
    new = Page(app, session="unknown")
    new.open()
    assert new.session not in [each.session for each in left]
    while folders[1].is_dir():  # the session that was left first ends
        time.sleep(0.01)
    assert folders[0].is_dir()
    assert left[0].resumes()
    assert not left[1].resumes()
    for each in (new, *left):
        each.close()
    assert page.ask("go", by=-1)["type"] == "done", "one that a page shows goes on"


def test_a_server_that_stops_closes_its_pages(options: SessionOptions) -> None:
    app = RunningApp(options)
    app.start()
    page = Page(app)
    page.open()
    app.stop()
    assert page.closed_with() in (SESSION_ENDED, 1012)
    page.close()
