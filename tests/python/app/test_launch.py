"""Test the command and the notebook. The command prints one line: the page's address, or an error with a remedy."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx2 as httpx
import numpy as np
import pytest
from app_page import Page, Shape

from dfd.app import show
from dfd.app.options import SessionOptions
from dfd.app.web import launch
from dfd.app.web.launch import RunningApp, check_built, serve
from dfd.cli import main
from dfd.editing.deformer import Deformer


def run(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    with pytest.raises(SystemExit) as done:
        main(["app", *arguments])
    assert isinstance(done.value.code, int)
    return done.value.code, capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing.glb"], "nothing.glb does not exist"),
        (["--field", "nothing"], "nothing does not exist"),
        (["--field", __file__], "MESH must be given"),
        ([__file__, "--sample", "chair"], "`--sample` must not be given with MESH"),
        (
            ["--allow-host", "https://hub"],
            "`--allow-host` must be a host name, such as hub.example.org, got 'https://hub'",
        ),
        (["--root-path", "p"], "`--root-path` must be a path, such as /user/me/app, got 'p'"),
        (["--sample", "sofa"], "no sample 'sofa'"),
        ([], "install Node (20 or newer)"),
    ],
)
def test_what_cannot_be_opened_is_said_in_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(launch, "check_built", lambda: check_built(tmp_path / "static"))
    code, said = run(["--no-browser", *arguments], capsys)
    assert code == 2
    assert message in said
    assert said.count("\n") == 1


def test_a_port_that_is_taken_is_said(static: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launch, "check_built", lambda: None)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match=f"cannot listen at 127.0.0.1:{port}"):
            serve(SessionOptions(), host="127.0.0.1", port=port, browser=False, tell=print)


PROGRAM = """
import sys
from pathlib import Path
from dfd.app.web import launch
launch.check_built = lambda: None
create = launch.create
launch.create = lambda *args, **options: create(*args, **{**options, "static": Path(sys.argv[1])})
from dfd.cli import main
main(["app", sys.argv[2], "--field", sys.argv[3], "--no-browser", "--port", "0"])
"""


@pytest.mark.processes
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_the_command_prints_an_address_serves_it_and_leaves_nothing(
    shape: Shape, static: Path, tmp_path: Path, end: signal.Signals
) -> None:
    arguments = [sys.executable, "-c", PROGRAM, str(static), str(shape.mesh), str(shape.field)]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True, env=environment)
    with process, process.stdout:
        line = process.stdout.readline()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32,}\n", line)
        with httpx.Client(follow_redirects=True, trust_env=False) as http:
            while True:
                try:
                    response = http.get(line.strip())
                    break
                except httpx.ConnectError:
                    assert process.poll() is None
        assert "<title>dfd</title>" in response.text
        assert any(tmp_path.glob("dfd-app-*"))
        process.send_signal(end)
        assert process.wait(30) in {signal.SIGINT: (0, 130), signal.SIGTERM: (143,)}[end]
    assert not any(tmp_path.glob("dfd-app-*"))


def test_a_browser_is_started_with_a_file_that_only_its_user_reads(static: Path) -> None:
    app = RunningApp(SessionOptions(), static=static)
    path = app.redirecting_file()
    assert path.stat().st_mode & 0o777 == 0o600
    assert app.url in path.read_text()
    assert app.rules.token not in path.as_uri()
    app.start()
    app.stop()
    assert not path.exists()


@pytest.fixture
def shown(deformer: Deformer, static: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningApp]:
    monkeypatch.setattr(launch, "check_built", lambda: None)
    monkeypatch.setattr(
        launch.RunningApp.__init__, "__kwdefaults__", {**launch.RunningApp.__init__.__kwdefaults__, "static": static}
    )
    frame = show(deformer)
    yield frame.app
    frame.app.stop()


def test_a_notebook_and_its_page_share_the_session(shown: RunningApp, deformer: Deformer) -> None:
    page = Page(shown)
    page.open()
    page.alive()
    page.hold(5, translation=[0, -0.3, 0])
    assert deformer.handles[0].transform.translation == (0, -0.3, 0)
    deformer.move(1, translation=(0, 0.2, 0))
    state = page.until(lambda message: message["type"] == "state")
    assert state["handles"][0]["translation"] == [0, 0.2, 0]
    positions = page.ask("compute")["arrays"]["positions"]
    np.testing.assert_allclose(positions + page.last("mesh")["center"], deformer.vertices, atol=1e-6)
    page.close()
    assert page.resumes()
    assert page.alive()["handles"]
    page.close()


def test_a_frame_goes_by_the_notebooks_name(shown: RunningApp, deformer: Deformer) -> None:
    frame = show(deformer, height=300)
    assert frame.app is shown, "one server for one session"
    text = frame._repr_html_()
    assert f'src="{shown.url}"' in text
    assert 'height="300"' in text
    with Page(shown).http() as http:
        assert (
            "frame-ancestors http://localhost:* http://127.0.0.1:*" in http.get("/").headers["content-security-policy"]
        )


def test_other_machines_are_let_in_with_a_warning(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    served: list[str] = []
    monkeypatch.setattr(launch, "serve", lambda options, *, host, **_: served.append(host))
    code, said = run(["--no-browser", "--host", "0.0.0.0"], capsys)
    assert (code, served) == (0, ["0.0.0.0"])
    assert "other machines can connect" in said
    assert run(["--no-browser"], capsys) == (0, "")


def test_the_address_stays_the_same_for_this_user_only(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = launch.kept_token()
    path = data / "token"
    assert launch.kept_token() == first == path.read_text()
    assert len(first) == 32
    if os.name == "posix":
        assert path.stat().st_mode & 0o077 == 0
        path.chmod(0o644)
        assert launch.kept_token() != first, "others may have read the file"
        path.chmod(0o600)
    path.write_text("short")
    assert launch.kept_token() not in ("short", first)
    monkeypatch.setenv("DFD_DATA", str(path))  # a file in place of the folder
    assert launch.kept_token() != launch.kept_token()


def test_servers_for_other_machines_and_notebooks_have_new_tokens(data: Path, static: Path) -> None:
    kept = launch.kept_token()
    for how in ({"host": "0.0.0.0"}, {"frame_ancestors": ("http://localhost:*",)}, {}):
        app = RunningApp(SessionOptions(), static=static, **how)  # type: ignore[arg-type]
        assert (app.rules.token == kept) == (not how)
        app._socket.close()
        app._root.cleanup()
