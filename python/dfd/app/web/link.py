"""How the server reaches a session: in a process of its own, or on a thread of this one."""

from __future__ import annotations

import asyncio
import contextlib
import pickle
import sys
import threading
from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.app.options import SessionOptions
from dfd.app.session.session import Session
from dfd.app.web.worker import BINARY, HEADER_BYTES, ORDER, TEXT, Loop, packet, payload_length

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

READ_AHEAD = 4 << 20  # bytes of a session's messages to buffer for a slow page
GRACE = 3.0  # seconds for a session to save and end


class Link(ABC):
    """The connection to one session; all methods are called on the event loop."""

    @abstractmethod
    async def start(self, folder: Path, options: SessionOptions, server_folder: Path | None) -> None:
        """Start a session, or restore the one saved in `folder`."""

    @abstractmethod
    async def send(self, text: str) -> None:
        """Forward a message of the page."""

    @abstractmethod
    async def order(self, name: str, **arguments: Any) -> None:
        """Call the session's method of that name."""

    @abstractmethod
    async def receive(self) -> str | bytes | None:
        """The next message for the page; None when the session has ended."""

    @abstractmethod
    async def close(self) -> None:
        """Let the session save and end; kill it after `GRACE` seconds."""


class ProcessLink(Link):
    """A session in a process of its own, which can be started in advance."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None

    async def prepare(self) -> None:
        """Start the process, which imports slow modules and waits."""
        if self._process is None:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "dfd.app.web.worker",
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=READ_AHEAD,
            )

    @property
    def pid(self) -> int | None:
        """The process id."""
        return None if self._process is None else self._process.pid

    async def start(self, folder: Path, options: SessionOptions, server_folder: Path | None) -> None:
        await self.prepare()
        await self.order("", folder=folder, options=options, server_folder=server_folder)

    async def send(self, text: str) -> None:
        await self._write(TEXT, text.encode())

    async def order(self, name: str, **arguments: Any) -> None:
        await self._write(ORDER, pickle.dumps((name, arguments)))

    async def _write(self, kind: bytes, data: bytes) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        with contextlib.suppress(ConnectionError):  # it has ended; `receive` returns None
            self._process.stdin.write(packet(kind, data))
            await self._process.stdin.drain()

    async def receive(self) -> str | bytes | None:
        assert self._process is not None
        assert self._process.stdout is not None
        try:
            header = await self._process.stdout.readexactly(HEADER_BYTES)
            data = await self._process.stdout.readexactly(payload_length(header))
        except (asyncio.IncompleteReadError, ConnectionError):
            await self._process.wait()
            return None
        return data if header[:1] == BINARY else data.decode()

    async def close(self) -> None:
        if self._process is None:
            return
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            await asyncio.wait_for(self._process.wait(), GRACE)
        except asyncio.TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
            await self._process.wait()
        # What the page has not taken yet would keep the pipes open until after the event loop has ended.
        self._process._transport.close()  # type: ignore[attr-defined]
        await asyncio.sleep(0)


class ThreadLink(Link):
    """The editing session that a notebook holds, on a thread of its process."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer = deformer
        self._loop = Loop()
        self._messages: asyncio.Queue[str | bytes | None] = asyncio.Queue()

    async def start(self, folder: Path, options: SessionOptions, server_folder: Path | None) -> None:
        events = asyncio.get_running_loop()

        def send(message: str | bytes | None) -> None:
            with contextlib.suppress(RuntimeError):  # the server has ended
                events.call_soon_threadsafe(self._messages.put_nowait, message)

        def run() -> None:
            self._loop.run(session)
            send(None)

        session = Session(folder, options, send, self._loop.post, server_folder=server_folder, deformer=self._deformer)
        self._loop.order("begin")
        threading.Thread(target=run, name="dfd-session", daemon=True).start()

    async def send(self, text: str) -> None:
        self._loop.page(text)

    async def order(self, name: str, **arguments: Any) -> None:
        self._loop.order(name, **arguments)

    async def receive(self) -> str | bytes | None:
        return await self._messages.get()

    async def close(self) -> None:
        self._loop.end()
