"""Test the real server: its files, whose requests it accepts, and requests that must not end it."""

import json
import re
from typing import Any

import pytest
from app_page import Page
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from dfd.app.web.launch import RunningApp
from dfd.app.web.safety import NOT_ALLOWED
from dfd.app.web.server import MESSAGE_BYTES

# --- the page's files


def test_the_page_and_its_files(app: RunningApp) -> None:
    with Page(app).http() as http:
        assert "<title>dfd</title>" in http.get("/").text
        script = http.get("/assets/index-1a2b.js")
        assert script.headers["content-type"].startswith("text/javascript")
        assert "immutable" in script.headers["cache-control"]
        assert http.get("/").headers["cache-control"] == "no-store"
        large = http.get("/assets/large-3c4d.js", headers={"Accept-Encoding": "gzip"})
        assert large.headers["content-encoding"] == "gzip"
        assert len(large.text) > 10 * int(large.headers["content-length"])
        for path in ("/../conftest.py", "/..%2fconftest.py", "/%2e%2e/conftest.py", "//etc/passwd", "/assets/"):
            assert http.get(path).status_code in (404, 405), path


def test_a_websocket_of_another_site_is_refused(app: RunningApp) -> None:
    cookie = {"Cookie": f"{app.rules.cookie}={app.rules.token}"}
    address = f"ws://127.0.0.1:{app.port}/ws"
    for origin in ("http://evil.example", "null", None):
        with pytest.raises(InvalidStatus) as refused:
            connect(address, origin=origin, additional_headers=cookie, proxy=None).__enter__()  # type: ignore[arg-type]
        assert refused.value.response.status_code == 403


def test_a_page_that_the_server_does_not_know_is_told_so_and_nothing_else(app: RunningApp) -> None:
    """A tab that was opened before a restart of the server has no valid cookie. It must not retry forever."""
    origin: Any = f"http://127.0.0.1:{app.port}"
    with connect(f"ws://127.0.0.1:{app.port}/ws", origin=origin, proxy=None) as socket:
        with pytest.raises(ConnectionClosed):
            socket.recv()
        assert socket.close_code == NOT_ALLOWED


# --- requests that must not end the server


@pytest.mark.parametrize(
    "text",
    [
        "no json",
        '{"type": "nothing", "id": 77}',
        '{"type": "move", "id": 77, "handle": 99, "transform": {}}',
        '{"type": "probe", "id": 77, "vertex": 100000000}',
        '{"type": "set_default", "id": 77, "transform": {"scale": [1e308, 1e308, 1e308]}}',
        '{"type": "add", "id": 77, "at": {"mask": "AAAA"}}',
        '{"type": "release", "id": 77, "index": 0}',
        '{"type": "open_sample", "id": 77, "name": "../../etc/passwd"}',
        '{"type": "distill", "id": 77}',
    ],
)
def test_what_makes_no_sense_is_a_failure_and_nothing_else(page: Page, text: str) -> None:
    page.write(text)
    failure = page.until(lambda message: message["type"] == "failure")
    assert failure["id"] == (77 if "77" in text else 0)
    assert failure["message"]
    answer = page.ask("add", at=5)
    assert answer["type"] == "done"
    assert len(page.last("state")["handles"]) == 1


def test_a_binary_message_is_a_failure(page: Page) -> None:
    page.write(b"\0\1\2")
    assert page.until(lambda message: message["type"] == "failure")["message"] == "Messages of the page must be text"
    assert page.ask("go", by=-1)["type"] == "done"


def test_a_message_that_is_too_long_ends_the_connection_and_not_the_session(page: Page) -> None:
    page.ask("add", at=5)
    page.write(json.dumps({"id": 1, "type": "open_sample", "name": "x" * MESSAGE_BYTES}))
    assert page.closed_with() == 1009
    assert page.resumes()
    page.alive()
    assert len(page.last("state")["handles"]) == 1


@pytest.mark.parametrize("name", ["", "0" * 32, "../.."])
def test_who_asks_for_a_session_that_there_is_not_gets_a_new_one(app: RunningApp, name: str) -> None:
    page = Page(app, session=name)
    page.open()
    assert re.fullmatch("[0-9a-f]{32}", page.session or "")
    assert page.session != name
    page.close()
