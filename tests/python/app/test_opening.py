"""Test the files that a page uploads to the real server."""

from pathlib import Path

import pytest
from app_page import Page, Shape
from made_field import made_field

import dfd
from dfd.app.options import SessionOptions
from dfd.app.web.launch import RunningApp
from dfd.editing.deformer import Deformer


def test_files_are_opened(new_page: Page, shape: Shape, deformer: Deformer, tmp_path: Path) -> None:
    page = new_page
    mesh, field = shape.mesh.read_bytes(), shape.field.read_bytes()
    assert page.upload({"mine.glb": mesh, "mine.field.safetensors": field}).status_code == 200
    assert page.until(lambda message: message["type"] == "mesh")["name"] == "mine.glb"
    page.alive()
    deformer.add(5, translation=(0, -0.3, 0), name="from a file")
    deformer.save(tmp_path / "edit.json")
    assert page.upload({"edit.json": (tmp_path / "edit.json").read_bytes()}).status_code == 200
    state = page.until(lambda message: message["type"] == "state" and message["handles"])
    assert state["handles"][0]["name"] == "from a file"
    assert page.upload({"other.safetensors": field}).status_code == 200
    page.alive()


def test_what_is_no_longer_open_is_deleted(app: RunningApp, new_page: Page, shape: Shape) -> None:
    page = new_page
    field = shape.field.read_bytes()
    for name in ("first.glb", "second.glb"):
        page.upload({name: shape.mesh.read_bytes(), "own.safetensors": field})
        page.until(lambda message, name=name: message["type"] == "mesh" and message["name"] == name)
        page.alive()
    tab = app.sessions.find(page.session)
    (kept,) = tab.folder.iterdir()
    page.upload({"third.glb": b"no mesh"})
    page.until(lambda message: message["type"] == "failure")
    assert list(tab.folder.iterdir()) == [kept], "what is still open"


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
    assert page.ask("add", at=5)["type"] == "done"


def test_refusals_of_another_shape_name_what_the_page_s_user_can_do(page: Page, shape: Shape, tmp_path: Path) -> None:
    mesh = dfd.load(shape.mesh)
    other = dfd.Mesh(3 * mesh.vertices, mesh.faces)
    field = made_field(16, center=other.bounds.mean(0), scale=0.7)
    field.save(tmp_path / "other.safetensors")
    session = Deformer(other, field)
    session.add(5, translation=(0, 0.1, 0))
    session.save(tmp_path / "edit.json")
    for name, remedy in (("other.safetensors", "distill a field from this mesh"), ("edit.json", "`dfd batch --edit` ")):
        page.upload({name: (tmp_path / name).read_bytes()})
        said = page.until(lambda message: message["type"] == "failure")["message"]
        assert remedy in said
        assert "other_shape" not in said
        page.heard.clear()


def test_uploads_are_refused_before_they_are_read(options: SessionOptions, static: Path) -> None:
    app = RunningApp(options, upload_bytes=1000, static=static)
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
