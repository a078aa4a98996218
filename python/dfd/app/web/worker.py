"""The process of one session. A crash, a hang or a lack of memory affects neither other sessions nor the server.

    python -m dfd.app.web.worker     reads packets from its input and writes packets to its output

A packet is its kind, one byte; the length of the payload, four bytes, little-endian; and the payload: a text of the
page, a binary message for it, or an order of the server: the pickled name and arguments of a method of the session. The
arguments of the first order construct the session, and the process ends when its input ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import pickle
import queue
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from dfd.app.protocol.requests import Request, RequestError, read_request
from dfd.app.session import requests
from dfd.app.session.session import Session

TEXT, BINARY, ORDER = b"T", b"B", b"O"
HEADER_BYTES = 5
OOM_SCORE_ADJ = "900"  # of 1000: when memory runs out, the kernel ends sessions first
NEWEST_ONLY = (
    "probe",
    "part",
    "compute",
)  # older requests of these are dropped: the pointer or the shape has changed since
SAVE_PAUSE = 0.5  # seconds without a request, after which the session is saved
INSTANCES_PAUSE = 0.05  # seconds without a request, after which instances are computed

Work = Callable[[Session], None]


def packet(kind: bytes, data: bytes) -> bytes:
    """The bytes of a packet."""
    return kind + len(data).to_bytes(4, "little") + data


def payload_length(header: bytes) -> int:
    """The length of the payload, from the first `HEADER_BYTES` of a packet."""
    return int.from_bytes(header[1:], "little")


class Loop:
    """The queue of a session's thread. `run` blocks the calling thread; all other methods are thread-safe."""

    def __init__(self) -> None:
        self._inbox: queue.Queue[Work | None] = queue.Queue()
        self._newest: dict[str, int] = {}

    def page(self, text: str) -> None:
        """Queue a message of the page."""
        try:
            message = read_request(text)
        except RequestError as error:
            self._inbox.put(lambda session, error=error: session.fail(error.number, str(error)))  # type: ignore[misc]
            return
        if message.type in NEWEST_ONLY:
            self._newest[message.type] = message.id
        self._inbox.put(lambda session: self._answer(session, message))

    def order(self, name: str, **arguments: Any) -> None:
        """Queue a call of a method of the session by the server."""
        self._inbox.put(lambda session: session.guarded(0, partial(getattr(session, name), **arguments)))

    def post(self, call: Callable[[], None]) -> None:
        """Queue a call for the session's thread."""
        self._inbox.put(lambda session: call())

    def end(self) -> None:
        """Let `run` return once the queue is empty."""
        self._inbox.put(None)

    def run(self, session: Session) -> None:
        """Process the queue until `end`."""
        resting = False
        while True:
            pending = session.has_pending_columns
            try:
                work = self._inbox.get(timeout=INSTANCES_PAUSE if pending else SAVE_PAUSE)
            except queue.Empty:
                session.guarded(0, session.send_pending_columns if pending else session.rest)
                if not pending and not resting:
                    _return_free_memory()
                resting = not pending
                continue
            resting = False
            if work is None:
                session.guarded(0, session.end)
                return
            work(session)

    def _answer(self, session: Session, message: Request) -> None:
        if message.type not in NEWEST_ONLY or message.id == self._newest[message.type]:
            requests.answer(session, message)


def main() -> None:
    """Run a session until the input ends."""
    logging.basicConfig(level=logging.WARNING, format="dfd app: %(message)s")
    source = os.fdopen(os.dup(0), "rb")
    output = os.fdopen(os.dup(1), "wb")
    # Libraries must not print into the packets, nor read them.
    os.dup2(2, 1)
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(OOM_SCORE_ADJ)
    _import_early()
    start = _read_packet(source)
    if start is None:
        return
    _, arguments = pickle.loads(start[1])
    _limit_memory(arguments["options"].memory_bytes)
    loop, writing = Loop(), threading.Lock()

    def send(message: str | bytes) -> None:
        kind, data = (TEXT, message.encode()) if isinstance(message, str) else (BINARY, message)
        with writing:
            output.write(packet(kind, data))
            output.flush()

    session = Session(send=send, post=loop.post, **arguments)
    loop.order("begin")
    threading.Thread(target=_read, args=(source, loop), name="dfd-reader", daemon=True).start()
    with contextlib.suppress(BrokenPipeError):
        loop.run(session)
    os._exit(0)  # without joining background threads


def _import_early() -> None:
    """Import slow modules while the process is still waiting for its first order."""
    import dfd.editing.deformer
    import dfd.mesh.mesh  # noqa: F401

    threading.Thread(target=lambda: __import__("dfd.field.field"), name="dfd-import", daemon=True).start()


def _return_free_memory() -> None:
    """Return to the system what was freed: GNU's C library keeps it, up to half of what a large shape takes."""
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError):  # another C library
            ctypes.CDLL(None).malloc_trim(0)


def _read(source: BinaryIO, loop: Loop) -> None:
    while (found := _read_packet(source)) is not None:
        kind, data = found
        if kind == TEXT:
            loop.page(data.decode())
        else:
            name, arguments = pickle.loads(data)
            loop.order(name, **arguments)
    loop.end()


def _read_packet(source: BinaryIO) -> tuple[bytes, bytes] | None:
    header = source.read(HEADER_BYTES)
    return (header[:1], source.read(payload_length(header))) if len(header) == HEADER_BYTES else None


def _limit_memory(max_bytes: int | None) -> None:
    """Make allocations beyond `max_bytes` raise a `MemoryError`, where the system supports such a limit."""
    if max_bytes is None or sys.platform == "win32":
        return
    import resource

    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (max_bytes, max_bytes))


if __name__ == "__main__":
    main()
