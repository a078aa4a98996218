"""The web server: the page's files, the WebSocket, uploads and downloads. Whatever takes time happens in sessions."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
from collections.abc import AsyncIterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from starlette.applications import Starlette
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from starlette.formparsers import MultiPartException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from dfd.app.options import SAMPLES
from dfd.app.protocol.answers import VERSION, FailureMessage, SessionMessage
from dfd.app.protocol.requests import Hello
from dfd.app.session.exports import EXPORTS
from dfd.app.web.safety import Guard, Rules
from dfd.app.web.tabs import NAME, SESSION_ENDED, Tab, Tabs
from dfd.app.web.uploads import FORMATS, MOST_FILES, UploadedFile, receive

STATIC = Path(__file__).parents[1] / "static"
MESSAGE_BYTES = 1 << 20  # the longest message of a page
UPLOAD_BYTES = 1 << 30  # an upload's files together, unpacked
HELLO_SECONDS = 10.0
FOREVER = "public, max-age=31536000, immutable"  # of files whose names change with what is in them


class PageFiles(StaticFiles):
    """The built page."""

    def file_response(self, full_path: object, *rest: object, **options: object) -> Response:
        """As Starlette's, kept by browsers where the name tells of the content."""
        response: Response = super().file_response(full_path, *rest, **options)  # type: ignore[arg-type]
        if "assets" in Path(str(full_path)).parts:
            response.headers["Cache-Control"] = FOREVER
        return response


def create(tabs: Tabs, rules: Rules, *, upload_bytes: int = UPLOAD_BYTES, static: Path = STATIC) -> Starlette:
    """The application for `tabs`, guarded by `rules`."""
    server = _Server(tabs, upload_bytes)

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        await tabs.start()
        try:
            yield
        finally:
            await tabs.stop()

    return Starlette(
        routes=[
            WebSocketRoute("/ws", server.socket),
            Route("/upload", server.upload, methods=["POST"]),
            Route("/download/{session}/{number}", server.download, methods=["GET"]),
            Mount("/", PageFiles(directory=static, html=True, check_dir=False)),
        ],
        middleware=[Middleware(Guard, rules=rules)],
        lifespan=lifespan,
    )


class _Server:
    """The three doors."""

    def __init__(self, tabs: Tabs, upload_bytes: int) -> None:
        self._tabs = tabs
        self._upload_bytes = upload_bytes

    async def socket(self, page: WebSocket) -> None:
        """Carry a page's messages to its session for as long as the page is there."""
        await page.accept()
        tab: Tab | None = None
        try:
            tab = await self._greet(page)
            while tab is not None:
                message = await page.receive()
                if message["type"] == "websocket.disconnect":
                    break
                text = message.get("text")
                if text is None:
                    await tab.tell(FailureMessage(message="Messages of the page must be text").model_dump_json())
                elif tab.link is not None:
                    await tab.link.send(text)
        except WebSocketDisconnect:
            pass
        finally:
            if tab is not None:
                tab.detach(page)

    async def _greet(self, page: WebSocket) -> Tab | None:
        """The tab of a page that says hello; None, once it is told why, of one that does not."""
        number = 0
        try:
            text = await asyncio.wait_for(page.receive_text(), HELLO_SECONDS)
            hello = Hello.model_validate_json(text)
            number = hello.id
            if hello.version != VERSION:
                raise ValueError("The page and the server are of different versions: reload the page")
            tab, resumed = await self._tabs.open(hello.session)
        except (ValueError, KeyError, asyncio.TimeoutError) as error:
            reason = str(error) if number else "The first message must be hello"
            await page.send_text(FailureMessage(id=number, message=reason, fatal=True).model_dump_json())
            await page.close(SESSION_ENDED)
            return None
        answer = SessionMessage(
            id=number,
            session=tab.name,
            resumed=resumed,
            dfd=_version(),
            samples=SAMPLES,
            upload_bytes=self._upload_bytes,
            formats=FORMATS,
        )
        await page.send_text(answer.model_dump_json())
        await tab.attach(page)
        return tab

    async def upload(self, request: Request) -> Response:
        """Take files for a session and have it open them; what comes of it, the page hears over its WebSocket."""
        tab = self._tabs.find(request.query_params.get("session", ""))
        if tab is None:
            return _refusal(404, "There is no such session: reload the page")
        length = request.headers.get("content-length", "")
        if not length.isdigit():
            return _refusal(411, "An upload must say how long it is")
        if int(length) > self._upload_bytes:
            return _refusal(413, f"The files are larger than {self._upload_bytes / 2**20:.0f} MiB")
        try:
            form = await request.form(max_files=MOST_FILES, max_fields=0)
        except (MultiPartException, HTTPException, KeyError) as error:
            return _refusal(400, f"The upload could not be read: {getattr(error, 'detail', error)}")
        except ClientDisconnect:
            return _refusal(400, "The upload was broken off")
        try:
            files = [
                UploadedFile(each.filename or "", each.file)
                for _, each in form.multi_items()
                if isinstance(each, UploadFile)
            ]
            if not files:
                return _refusal(400, "An upload must hold at least one file")
            upload = await run_in_threadpool(receive, files, tab.folder, self._upload_bytes)
        except ValueError as error:
            return _refusal(400, str(error))
        except OSError as error:
            return _refusal(507, f"The files could not be kept: {error.strerror}")
        finally:
            await form.close()
        await tab.order("open_files", mesh=upload.mesh, field=upload.field, edit=upload.edit)
        return JSONResponse({})

    async def download(self, request: Request) -> Response:
        """Give away an export, once."""
        tab, number = self._tabs.find(request.path_params["session"]), request.path_params["number"]
        place = None if tab is None or not NAME.fullmatch(number) else tab.folder / EXPORTS / number
        files = [] if place is None else await run_in_threadpool(_files, place)
        if place is None or len(files) != 1:
            return _refusal(404, "There is no such file: it can be taken once")
        # Taken out of the way first, so that nobody else gets it.
        taken = place.with_name(f"{place.name}-taken")
        with contextlib.suppress(OSError):
            place.rename(taken)
            return FileResponse(
                taken / files[0].name,
                filename=files[0].name,
                media_type="application/octet-stream",
                background=BackgroundTask(shutil.rmtree, taken, ignore_errors=True),
            )
        return _refusal(404, "There is no such file: it can be taken once")


def _files(place: Path) -> list[Path]:
    return sorted(place.iterdir()) if place.is_dir() else []


def _refusal(status: int, sentence: str) -> JSONResponse:
    return JSONResponse({"message": sentence}, status)


def _version() -> str:
    try:
        return version("dfd")
    except PackageNotFoundError:
        return "not installed"
