"""The real server with real sessions in processes of their own: what a page does, and what must not bring it down."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from app_page import Page, Shape
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import dfd
from dfd.app.launch import RunningApp
from dfd.app.link import ProcessLink
from dfd.app.options import SessionOptions
from dfd.app.server import MESSAGE_BYTES, Limits
from dfd.app.tabs import OPENED_ELSEWHERE, SESSION_ENDED
from dfd.editing.deformer import Deformer


def process_of(page: Page) -> int:
    assert page.session is not None
    tab = page.app.tabs.find(page.session)
    assert tab is not None
    assert isinstance(tab.link, ProcessLink)
    assert tab.link.pid is not None
    return tab.link.pid


# --- the page's files


def test_the_page_and_its_files(app: RunningApp) -> None:
    with Page(app).http() as http:
        assert "<title>dfd</title>" in http.get("/").text
        script = http.get("/assets/index-1a2b.js")
        assert script.headers["content-type"].startswith("text/javascript")
        assert "immutable" in script.headers["cache-control"]
        assert http.get("/").headers["cache-control"] == "no-store"
        for path in ("/../conftest.py", "/..%2fconftest.py", "/%2e%2e/conftest.py", "//etc/passwd", "/assets/"):
            assert http.get(path).status_code in (404, 405), path


def test_the_printed_address_opens_the_page(app: RunningApp) -> None:
    import httpx2 as httpx

    with httpx.Client(follow_redirects=True, trust_env=False) as http:
        response = http.get(app.url)
        assert response.text.startswith("<!doctype html>")
        assert "token" not in str(response.url)
        assert http.get(f"http://127.0.0.1:{app.port}/").status_code == 200


def test_a_websocket_of_another_site_is_refused(app: RunningApp) -> None:
    cookie = {"Cookie": f"{app.rules.cookie}={app.rules.token}"}
    address = f"ws://127.0.0.1:{app.port}/ws"
    for origin, headers in (
        ("http://evil.example", cookie),
        ("null", cookie),
        (None, cookie),
        (f"http://127.0.0.1:{app.port}", {}),
    ):
        with pytest.raises(InvalidStatus) as refused:
            connect(address, origin=origin, additional_headers=headers, proxy=None).__enter__()  # type: ignore[arg-type]
        assert refused.value.response.status_code == 403


# --- what a page does


def test_a_shape_is_shown_and_edited(page: Page, deformer: Deformer) -> None:
    mesh = page.last("mesh")
    assert (mesh["name"], mesh["vertices"]) == ("chair.glb", len(deformer.mesh.vertices))
    handle = page.ask("add", at={"vertex": 5}, transform={"translation": [0, -0.3, 0]}, controls={"name": "foot"})[
        "handle"
    ]
    state = page.last("state")
    assert state["handles"][0]["name"] == "foot"
    assert page.last("columns")["columns"][0]["column"] == state["handles"][0]["column"]
    assert "Moved" in page.last("report")["text"]
    deformer.add(5, translation=(0, -0.3, 0))
    answer = page.ask("compute")
    np.testing.assert_allclose(
        answer["arrays"]["positions"] + np.array(mesh["center"]), deformer.vertices, atol=1e-6 * mesh["diagonal"]
    )

    heard = len(page.heard)
    for step in range(5):
        page.ask("move", handle=handle, transform={"translation": [0, -0.1 * step, 0]}, merge=step > 0)
    sizes = [len(json.dumps(message)) for message in page.heard[heard + 3 :]]
    assert max(sizes) < 2000, "frames of a drag are small"
    page.ask("move", handle=handle, transform={"translation": [0, -0.5, 0]}, merge=True, settle=True)
    assert page.last("state")["handles"][0]["translation"] == [0, -0.5, 0]
    page.ask("undo")
    assert page.last("state")["handles"][0]["translation"] == [0, -0.3, 0]
    page.ask("redo")
    page.ask("fix", at={"point": [0, 0.8, -0.2]})
    page.ask("set_symmetry", plane="x")
    assert page.last("state")["symmetry"]["normal"] == [1, 0, 0]
    page.ask("release", index=0)
    page.ask("reset")
    assert page.last("report")["moved"] == 0
    page.ask("remove", handle=handle)
    assert page.last("state")["handles"] == []
    assert page.last("state")["can_undo"]


def test_an_edit_document_goes_in_and_out(page: Page, deformer: Deformer) -> None:
    deformer.add(7, rotation=(0, 30, 0), name="seven")
    deformer.fix(300)
    from dfd.editing.edit_file import to_document

    document = to_document(deformer.edit, deformer.mesh)
    page.ask("apply", edit=document)
    assert page.last("state")["edit"] == json.loads(json.dumps(document))
    page.ask("clear")
    assert page.last("state")["handles"] == []


def test_the_newest_probe_is_answered(page: Page) -> None:
    numbers = [page.say("probe", at={"vertex": vertex}) for vertex in range(30)]
    answer = page.until(lambda message: message["type"] == "heat" and message["id"] == numbers[-1])
    assert answer["arrays"]["values"][29] == 0
    answered = [message["id"] for message in page.heard if message["type"] == "heat"]
    assert answered == sorted(answered)


def test_features_suggestions_poses_and_script(page: Page) -> None:
    colors = page.ask("features")["arrays"]["colors"]
    assert len(np.unique(colors[:, :3], axis=0)) > 100
    suggestions = page.ask("suggest", count=5)["suggestions"]
    assert 1 <= len({each["vertex"] for each in suggestions}) == len(suggestions) <= 5
    assert all(0 < each["share"] <= 1 for each in suggestions)
    pose = {
        "name": "one",
        "seconds": 1.5,
        "transforms": [
            {
                "handle": 1,
                "translation": [0, 1, 0],
                "rotation": [0, 0, 0],
                "scale": [1, 1, 1],
                "pivot": None,
                "axes": None,
            }
        ],
    }
    page.ask("set_poses", poses=[pose])
    assert page.last("state")["poses"] == [pose]
    assert "dfd.Deformer" in page.ask("script")["python"]


def test_an_export_is_given_once(page: Page, deformer: Deformer, tmp_path: Path) -> None:
    page.ask("add", at={"vertex": 5}, transform={"translation": [0, -0.3, 0]})
    answer = page.ask("export", format="glb")
    assert answer["name"] == "chair_edited.glb"
    with page.http() as http:
        response = http.get(answer["url"])
        assert 'filename="chair_edited.glb"' in response.headers["content-disposition"]
        assert http.get(answer["url"]).status_code == 404
    (tmp_path / "made.glb").write_bytes(response.content)
    deformer.add(5, translation=(0, -0.3, 0))
    np.testing.assert_allclose(dfd.load(tmp_path / "made.glb").vertices, deformer.vertices, atol=2e-6)


def test_downloads_are_named_by_the_server_alone(page: Page) -> None:
    page.ask("export", format="edit")
    with page.http() as http:
        for path in (
            f"/download/{page.session}/../session.json",
            f"/download/{page.session}/..%2fsession.json",
            f"/download/..%2f{page.session}/exports",
            f"/download/{page.session}/{'0' * 32}",
            f"/download/{'0' * 32}/{'0' * 32}",
        ):
            assert http.get(path).status_code == 404


# --- uploads


def test_files_are_opened(new_page: Page, shape: Shape, deformer: Deformer, tmp_path: Path) -> None:
    page = new_page
    mesh, field = shape.mesh.read_bytes(), shape.field.read_bytes()
    assert page.upload({"mine.glb": mesh, "mine.field.safetensors": field}).json() == {"kind": "mesh"}
    assert page.until(lambda message: message["type"] == "mesh")["name"] == "mine.glb"
    page.alive()
    deformer.add(5, translation=(0, -0.3, 0), name="from a file")
    deformer.save(tmp_path / "edit.json")
    assert page.upload({"edit.json": (tmp_path / "edit.json").read_bytes()}).json() == {"kind": "edit"}
    state = page.until(lambda message: message["type"] == "state" and message["handles"])
    assert state["handles"][0]["name"] == "from a file"
    assert page.upload({"other.safetensors": field}).json() == {"kind": "field"}
    page.alive()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.glb", b"no mesh"),
        ("a.obj", b"v 0 0 0\n"),
        ("a.stl", b""),
        ("a.ply", b"ply\nformat ascii 1.0\n"),
        ("a.json", b"{"),
        ("a.safetensors", b"\0" * 8),
    ],
)
def test_a_file_that_is_none_is_said_and_what_was_open_stays(page: Page, name: str, content: bytes) -> None:
    page.upload({name: content})
    failure = page.until(lambda message: message["type"] == "failure")
    assert "/" not in failure["message"], "no place of this machine"
    assert page.ask("add", at={"vertex": 5})["type"] == "done"


def test_uploads_are_refused_before_they_are_read(options: SessionOptions, static: Path) -> None:
    app = RunningApp(options, limits=Limits(upload_bytes=1000), static=static)
    app.start()
    try:
        page = Page(app)
        page.open()
        response = page.upload({"a.obj": b"x" * 2000})
        assert (response.status_code, "larger" in response.json()["message"]) == (413, True)
        with page.http() as http:
            chunks = http.post("/upload", params={"session": page.session}, content=iter([b"x"] * 3))
            assert chunks.status_code == 411
            assert http.post("/upload", params={"session": "0" * 32}, files={"files": b"x"}).status_code == 404
            assert http.post("/upload", params={"session": "../.."}, files={"files": b"x"}).status_code == 404
            wrong = http.post(
                "/upload",
                params={"session": page.session},
                content=b"x",
                headers={"Content-Type": "multipart/form-data"},
            )
            assert wrong.status_code == 400
            assert http.post("/upload", params={"session": page.session}, content=b"x").status_code == 400
            foreign = http.post("/upload", params={"session": page.session}, headers={"Origin": "http://evil.example"})
            assert foreign.status_code == 403
        page.close()
    finally:
        app.stop()


# --- what must not bring it down


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no json",
        "[]",
        "[" * 100_000,
        '{"type": "undo"}',
        '{"type": "nothing", "id": 77}',
        '{"type": "move", "id": 77, "handle": 1, "transform": {"translation": [0, 0, NaN]}}',
        '{"type": "move", "id": 77, "handle": 1, "transform": {"translation": [0, 0]}}',
        '{"type": "move", "id": 77, "handle": 99, "transform": {}}',
        '{"type": "probe", "id": 77, "at": {"vertex": 100000000}}',
        '{"type": "add", "id": 77, "at": {"vertex": 1}, "transform": {"scale": [1e308, 1e308, 1e308]}}',
        '{"type": "add", "id": 77, "at": {"vertex": 1}, "controls": {"more": {"at": 3}}}',
        '{"type": "add", "id": 77, "at": {"vertex": 1}, "controls": {"more": {"self": 3}}}',
        '{"type": "add", "id": 77, "at": {"mask": "AAAA"}}',
        '{"type": "apply", "id": 77, "edit": {"format": "another"}}',
        '{"type": "release", "id": 77, "index": 0}',
        '{"type": "remove", "id": 77, "handle": 1}',
        '{"type": "open_sample", "id": 77, "name": "../../etc/passwd"}',
        '{"type": "distill", "id": 77}',
    ],
)
def test_what_makes_no_sense_is_a_failure_and_nothing_else(page: Page, text: str) -> None:
    page.write(text)
    failure = page.until(lambda message: message["type"] == "failure")
    assert failure["id"] == (77 if "77" in text else 0)
    assert failure["message"]
    assert not failure["fatal"]
    answer = page.ask("add", at={"vertex": 5})
    assert answer["type"] == "done"
    assert len(page.last("state")["handles"]) == 1


def test_a_binary_message_is_a_failure(page: Page) -> None:
    page.write(b"\0\1\2")
    assert page.until(lambda message: message["type"] == "failure")["message"] == "Messages of the page must be text"
    assert page.ask("undo")["type"] == "done"


def test_a_message_that_is_too_long_ends_the_connection_and_not_the_session(page: Page) -> None:
    page.ask("add", at={"vertex": 5})
    page.write(json.dumps({"id": 1, "type": "apply", "edit": {"x": "y" * MESSAGE_BYTES}}))
    assert page.closed_with() == 1009
    assert page.open()["resumed"]
    page.alive()
    assert len(page.last("state")["handles"]) == 1


@pytest.mark.parametrize("hello", ['{"type": "undo", "id": 1}', "nonsense", '{"type": "hello", "id": 1, "version": 0}'])
def test_who_does_not_say_hello_is_told_and_sent_away(app: RunningApp, hello: str) -> None:
    page = Page(app)
    page.connect()
    page.write(hello)
    answer = page.hear()
    assert (answer["type"], answer["fatal"]) == ("failure", True)
    assert page.closed_with() == SESSION_ENDED
    page.close()


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
    assert "begins anew" in page.until(lambda message: message["type"] == "failure")["message"]


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
