"""The web server: the page's files, the WebSocket, uploads and downloads. Long work runs on the threads of sessions."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from dfd.app.options import SAMPLES, SessionOptions
from dfd.app.protocol.messages import FailureMessage, SessionMessage
from dfd.app.web.safety import Guard, Rules
from dfd.app.web.tab import Outbox, Tab
from dfd.app.web.uploads import BESIDE, FORMATS, MOST_FILES, receive

STATIC = Path(__file__).parents[1] / "static"
MESSAGE_BYTES = 1 << 20  # largest size of a message from a page, in bytes
UPLOAD_BYTES = 1 << 30  # largest total size of the unpacked files of an upload, in bytes
MOST_UNATTENDED = 8  # largest number of sessions without a page; those whose pages disconnected first are ended


def create(sessions: Sessions, rules: Rules, *, static: Path) -> Starlette:
    """Return the application for `sessions`, guarded by `rules`, with the built page in the folder `static`."""

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        sessions.close()

    return Starlette(
        routes=[
            WebSocketRoute("/ws", sessions.socket),
            Route("/upload", sessions.upload, methods=["POST"]),
            Route("/download/{session}/{number}", sessions.download, methods=["GET"]),
            Mount("/", GZipMiddleware(StaticFiles(directory=static, html=True, check_dir=False))),
        ],
        middleware=[Middleware(Guard, rules=rules)],
        lifespan=lifespan,
    )


class Sessions:
    """All sessions of one server, and the routes to them. Each session has its own folder in `root`."""

    def __init__(self, root: Path, options: SessionOptions, upload_bytes: int) -> None:
        self._root, self._options, self._upload_bytes = root, options, upload_bytes
        self._tabs: dict[str, Tab] = {}  # by session name; the tab whose page disconnected last is the last

    def find(self, name: str | None) -> Tab | None:
        """Return the tab of the session `name`, or None if there is no such session."""
        return self._tabs.get(name or "")

    def _open(self, name: str | None) -> Tab:
        """Return the `Tab` of the session `name`. Without a name, return the one whose page was closed last.

        If there is none, return a new one. In a notebook, all pages share one session.
        """
        if (found := self.find(name)) is not None:
            return found
        if self._options.deformer is not None and self._tabs:
            return next(iter(self._tabs.values()))
        unattended = [each for each in self._tabs.values() if each.outbox is None]
        if not name and unattended:
            return unattended[-1]
        for tab in unattended[:-MOST_UNATTENDED]:
            self._tabs.pop(tab.folder.name).end()
        folder = self._root / secrets.token_hex(16)
        folder.mkdir()
        self._tabs[folder.name] = tab = Tab(folder, self._options)
        return tab

    def close(self) -> None:
        """End all sessions."""
        for tab in self._tabs.values():
            tab.end()

    def join(self) -> None:
        """Wait until the threads of all sessions have stored their edits."""
        while self._tabs:
            self._tabs.popitem()[1].join()

    async def socket(self, page: WebSocket) -> None:
        """Pass messages between a page and its session, or a new session, until the page disconnects."""
        await page.accept()
        tab = self._open(page.query_params.get("session"))
        name, outbox = tab.folder.name, tab.attach(page.query_params.get("kept", ""))
        greeting = SessionMessage(
            session=name, samples=SAMPLES, upload_bytes=self._upload_bytes, formats=FORMATS, beside=BESIDE
        )
        tab.tell(greeting.model_dump_json())
        sending = asyncio.create_task(_send_all(page, outbox))
        try:
            while (message := await page.receive())["type"] != "websocket.disconnect":
                if message.get("text") is None:
                    tab.tell(FailureMessage(message="Messages of the page must be text").model_dump_json())
                else:
                    tab.ask(message["text"])
        finally:
            sending.cancel()
            if tab.outbox is outbox:
                tab.outbox = None
                tab.call(tab.session.detach)
            if self._tabs.pop(name, None) is not None:
                self._tabs[name] = tab

    async def upload(self, request: Request) -> Response:
        """Receive files, and let the session open them. The session sends the result over the WebSocket."""
        tab = self.find(request.query_params.get("session"))
        if tab is None:
            return _refusal(404, "There is no such session: reload the page")
        length = request.headers.get("content-length", "")
        if not length.isdigit():
            return _refusal(411, "An upload must have a Content-Length header")
        if int(length) > self._upload_bytes:
            return _refusal(413, f"The files are larger than {self._upload_bytes / 2**20:.0f} MiB")
        try:
            async with request.form(max_files=MOST_FILES, max_fields=0) as form:
                given = [each for _, each in form.multi_items() if isinstance(each, UploadFile)]
                files = [(each.filename or "", each.file) for each in given]
                upload = await run_in_threadpool(receive, files, tab.folder, self._upload_bytes)
        except (MultiPartException, HTTPException, KeyError) as error:
            return _refusal(400, f"The upload could not be read: {getattr(error, 'detail', error)}")
        except ClientDisconnect:
            return _refusal(400, "The upload was interrupted")
        except ValueError as error:
            return _refusal(400, str(error))
        except OSError as error:
            return _refusal(507, f"The files could not be stored: {error.strerror}")
        tab.call(lambda: tab.session.open(upload))
        return JSONResponse({})

    async def download(self, request: Request) -> Response:
        """Serve an exported file once."""
        tab = self.find(request.path_params["session"])
        path = None if tab is None else tab.session.exports.pop(request.path_params["number"], None)
        if path is None or not path.is_file():
            return _refusal(404, "There is no such file: a file can be downloaded only once")
        delete = BackgroundTask(shutil.rmtree, path.parent, ignore_errors=True)
        return FileResponse(path, filename=path.name, media_type="application/octet-stream", background=delete)


async def _send_all(page: WebSocket, outbox: Outbox) -> None:
    """Send the messages in `outbox` to the page. If a message is a close code, close the connection with this code."""
    with contextlib.suppress(RuntimeError, OSError, WebSocketDisconnect):
        while not isinstance(message := await outbox.get(), int):
            await (page.send_text(message) if isinstance(message, str) else page.send_bytes(message))
        await page.close(message)


def _refusal(status: int, sentence: str) -> JSONResponse:
    return JSONResponse({"message": sentence}, status)
