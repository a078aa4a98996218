"""One open session: its thread, and the page that shows it."""

import asyncio
import contextlib
import queue
import shutil
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from dfd.app.options import SessionOptions
from dfd.app.protocol.requests import RequestError, read_request
from dfd.app.session.requests import answer
from dfd.app.session.session import Session

OPENED_ELSEWHERE, SESSION_ENDED = 4001, 4002  # close codes of a WebSocket
# For each of these types, only the newest request is answered. Older ones are for an earlier pointer position or pose.
NEWEST_ONLY = ("probe", "compute")
LONGEST_END = 30.0  # seconds; a session that ends may first have to finish a long computation
REST_PAUSE = 0.2  # after this number of seconds without a request, the session does deferred work

Outbox = asyncio.Queue[str | bytes | int]  # messages to a page, or a close code, which closes the page's WebSocket


class Tab:
    """A session, the thread that does the session's work in order, and the page that shows the session, if any.

    A session continues when its page is reloaded. `call` may be called on any thread. All other public methods must
    be called on the event loop.
    """

    def __init__(self, folder: Path, options: SessionOptions) -> None:
        self.folder = folder
        self.outbox: Outbox | None = None  # messages for the page; None if no page shows the session
        self._events = asyncio.get_running_loop()
        self._begun = False
        self._inbox: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._newest: dict[str, int] = {}
        self.session = Session(folder, options, self._send, self.call)
        self._thread = threading.Thread(target=self._run, name="dfd-session", daemon=True)
        self._thread.start()

    def call(self, work: Callable[[], None]) -> None:
        """Queue `work` for the session's thread. If `work` raises an exception, the page gets a `failure` message."""
        self._inbox.put(work)

    def ask(self, text: str) -> None:
        """Queue a request of the page."""
        try:
            request = read_request(text)
        except RequestError as error:
            self.call(partial(self.session.fail, error.number, error))
            return
        if request.type in NEWEST_ONLY:
            self._newest[request.type] = request.id

        def work() -> None:
            if self._newest.get(request.type, request.id) == request.id:
                answer(self.session, request)

        self.call(work)

    def _run(self) -> None:
        """Do the work in the queue until the session ends. While the queue is empty, do deferred work."""
        while True:
            try:
                work = self._inbox.get(timeout=REST_PAUSE)
            except queue.Empty:
                work = self.session.run_deferred
            if work is None:
                self.session.close_shape()
                shutil.rmtree(self.folder, ignore_errors=True)
                return
            self.session.guarded(0, work)

    def _send(self, message: str | bytes) -> None:
        """Pass a message from the session's thread to the event loop."""
        with contextlib.suppress(RuntimeError):  # the event loop has ended
            self._events.call_soon_threadsafe(self.tell, message)

    def tell(self, message: str | bytes | int) -> None:
        """Send a message to the page, or close the connection with a code. Without a page, do nothing."""
        if self.outbox is not None:
            self.outbox.put_nowait(message)

    def attach(self, key: str = "") -> Outbox:
        """Disconnect the page that was attached before, if any, and return the outbox of a new page.

        The first page may name the kept edit that it showed before, by its `key`.
        """
        self.tell(OPENED_ELSEWHERE)
        outbox = self.outbox = asyncio.Queue()
        self.call(self.session.attach if self._begun else partial(self.session.begin, key))
        self._begun = True
        return outbox

    def end(self) -> None:
        """Disconnect the page. After the work in the queue, store the edit and delete the session's files."""
        self.tell(SESSION_ENDED)
        self._inbox.put(None)

    def join(self) -> None:
        """Wait until the session has ended, but not longer than `LONGEST_END`."""
        self._thread.join(LONGEST_END)
