"""The open sessions. Each has its own thread, and continues when its page is reloaded."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import secrets
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from dfd.app.options import SessionOptions
from dfd.app.protocol.requests import RequestError, read_request
from dfd.app.session.requests import answer
from dfd.app.session.session import Session

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

OPENED_ELSEWHERE, SESSION_ENDED = 4001, 4002  # close codes of a WebSocket
MOST_UNATTENDED = 8  # number of sessions without a page; above it, the session that was left first ends
# Only the newest of these requests is answered, because the pointer or the shape has changed since older requests.
NEWEST_ONLY = ("probe", "compute")
REST_PAUSE = 0.2  # seconds without a request after which the session does deferred work

Outbox = asyncio.Queue[str | bytes | int]  # messages for a page; a number closes its WebSocket with this code


class Tab:
    """A session, the thread that does its work in order, and the page that shows it, if any.

    `call` is safe on any thread. All other methods are called on the event loop.
    """

    def __init__(self, folder: Path, options: SessionOptions, deformer: Deformer | None) -> None:
        self.name, self.folder = folder.name, folder
        self._events = asyncio.get_running_loop()
        self._outbox: Outbox | None = None
        self._begun = False
        self._inbox: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._newest: dict[str, int] = {}
        self.session = Session(folder, options, self._send, self.call, deformer=deformer)
        threading.Thread(target=self._run, name="dfd-session", daemon=True).start()

    def call(self, work: Callable[[], None]) -> None:
        """Queue work; an exception is sent to the page as a failure."""
        self._inbox.put(work)

    def ask(self, text: str) -> None:
        """Queue a request of the page."""
        try:
            request = read_request(text)
        except RequestError as error:
            number, why = error.number, str(error)
            self.call(lambda: self.session.fail(number, why))
            return
        if request.type in NEWEST_ONLY:
            self._newest[request.type] = request.id

        def work() -> None:
            if self._newest.get(request.type, request.id) == request.id:
                answer(self.session, request)

        self.call(work)

    def _run(self) -> None:
        """Do the work in the queue until the session ends, and deferred work while the queue is empty."""
        while True:
            try:
                work = self._inbox.get(timeout=REST_PAUSE)
            except queue.Empty:
                work = self.session.run_deferred
            if work is None:
                self.session.end()
                return
            self.session.guarded(0, work)

    def _send(self, message: str | bytes) -> None:
        """Pass a message from the session's thread to the event loop."""
        with contextlib.suppress(RuntimeError):  # the event loop has ended
            self._events.call_soon_threadsafe(self.tell, message)

    def tell(self, message: str | bytes | int) -> None:
        """Send a message, or close the connection with a code, if a page shows the session."""
        if self._outbox is not None:
            self._outbox.put_nowait(message)

    @property
    def attended(self) -> bool:
        """Return whether a page shows the session."""
        return self._outbox is not None

    def attach(self) -> Outbox:
        """Return the outbox of a new page; a previous page is closed."""
        self.tell(OPENED_ELSEWHERE)
        outbox = self._outbox = asyncio.Queue()
        self.call(self.session.attach if self._begun else self.session.begin)
        self._begun = True
        return outbox

    def detach(self, outbox: Outbox) -> None:
        """Record that the page with this outbox has disconnected."""
        if self._outbox is outbox:
            self._outbox = None

    def end(self) -> None:
        """End the session after the work in the queue, delete its files and close its page."""
        self.tell(SESSION_ENDED)
        self._inbox.put(None)
        shutil.rmtree(self.folder, ignore_errors=True)


class Sessions:
    """All sessions of one server, with folders in `root`. With `deformer`, all pages show this editing session."""

    def __init__(self, root: Path, options: SessionOptions, deformer: Deformer | None = None) -> None:
        self._root, self._options, self._deformer = root, options, deformer
        self._tabs: dict[str, Tab] = {}  # tabs by name; the last one was left last

    def find(self, name: str | None) -> Tab | None:
        """Return the session with a name, or None."""
        return self._tabs.get(name or "")

    def open(self, name: str | None) -> Tab:
        """Return the session with a name, or a new session."""
        if (found := self.find(name)) is not None:
            return found
        if self._deformer is not None and self._tabs:
            return next(iter(self._tabs.values()))
        for tab in [each for each in self._tabs.values() if not each.attended][:-MOST_UNATTENDED]:
            self._tabs.pop(tab.name).end()
        folder = self._root / secrets.token_hex(16)
        folder.mkdir()
        self._tabs[folder.name] = tab = Tab(folder, self._options, self._deformer)
        return tab

    def leave(self, tab: Tab, outbox: Outbox) -> None:
        """Record that a page has disconnected."""
        tab.detach(outbox)
        if self._tabs.pop(tab.name, None) is not None:
            self._tabs[tab.name] = tab

    def close(self) -> None:
        """End all sessions."""
        while self._tabs:
            self._tabs.popitem()[1].end()
