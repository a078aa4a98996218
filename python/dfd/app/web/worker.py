"""The process of one session. It may crash, hang or run out of memory: no other session and no server notices.

    python -m dfd.app.web.worker     reads frames from its input and writes frames to its output

A frame is its kind, one byte; the length of what follows, four bytes, little-endian; and that. The first is an `ORDER`
with a `Start`, and the process ends when its input ends.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import threading
from functools import partial
from pathlib import Path
from typing import BinaryIO, Literal

from pydantic import BaseModel, ConfigDict

from dfd.app.options import OpenedFile, SessionOptions, Source
from dfd.app.session.session import Session
from dfd.app.web.loop import Loop

__all__ = [
    "BINARY",
    "HEADER_BYTES",
    "ORDER",
    "TEXT",
    "Attach",
    "Open",
    "Start",
    "frame",
    "frame_length",
    "obey",
    "order_frame",
]

TEXT, BINARY, ORDER = b"T", b"B", b"O"
HEADER_BYTES = 5
FIRST_TO_GO = "900"  # of 1000: whom the kernel ends first when memory runs out


class Order(BaseModel):
    """What the server says to the process."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Start(Order):
    """Be the session in this folder."""

    do: Literal["start"] = "start"
    folder: Path
    options: SessionOptions
    lock: Path | None


class Attach(Order):
    """A page has come: tell it everything."""

    do: Literal["attach"] = "attach"


class Open(Order):
    """Open files that were uploaded."""

    do: Literal["open"] = "open"
    mesh: Source | None = None
    field: OpenedFile | None = None
    edit: OpenedFile | None = None


class _AnyOrder(BaseModel):
    order: Start | Attach | Open


def frame(kind: bytes, data: bytes) -> bytes:
    """A frame's bytes."""
    return kind + len(data).to_bytes(4, "little") + data


def frame_length(header: bytes) -> int:
    """How much follows the first `HEADER_BYTES` of a frame."""
    return int.from_bytes(header[1:], "little")


def order_frame(order: Order) -> bytes:
    """An order's frame."""
    return frame(ORDER, f'{{"order": {order.model_dump_json()}}}'.encode())


def main() -> None:
    """Be a session until the input ends."""
    logging.basicConfig(level=logging.WARNING, format="dfd app: %(message)s")
    source = os.fdopen(os.dup(0), "rb")
    output = os.fdopen(os.dup(1), "wb")
    # Whatever a library prints or reads has nothing to do with frames.
    os.dup2(2, 1)
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(FIRST_TO_GO)
    _import_early()
    start = _read_order(source)
    if not isinstance(start, Start):
        return
    _limit_memory(start.options.memory_bytes)
    loop, writing = Loop(), threading.Lock()

    def send(message: str | bytes) -> None:
        kind, data = (TEXT, message.encode()) if isinstance(message, str) else (BINARY, message)
        with writing:
            output.write(frame(kind, data))
            output.flush()

    session = Session(start.folder, start.options, send, loop.post, lock=start.lock)
    loop.order(lambda session: session.guarded(0, session.begin))
    threading.Thread(target=_read, args=(source, loop), name="dfd-reader", daemon=True).start()
    with contextlib.suppress(BrokenPipeError):
        loop.run(session)
    os._exit(0)  # no thread of the background is worth waiting for


def _import_early() -> None:
    """Import what takes seconds while nobody waits for it yet."""
    import dfd.editing.deformer
    import dfd.mesh.mesh  # noqa: F401

    threading.Thread(target=lambda: __import__("dfd.field.field"), name="dfd-import", daemon=True).start()


def _read(source: BinaryIO, loop: Loop) -> None:
    while (header := source.read(HEADER_BYTES)) and len(header) == HEADER_BYTES:
        data = source.read(frame_length(header))
        if header[:1] == TEXT:
            loop.page(data.decode())
        else:
            order = _AnyOrder.model_validate_json(data).order
            loop.order(partial(obey, order=order))
    loop.end()


def _read_order(source: BinaryIO) -> Order | None:
    header = source.read(HEADER_BYTES)
    if len(header) < HEADER_BYTES:
        return None
    return _AnyOrder.model_validate_json(source.read(frame_length(header))).order


def obey(session: Session, order: Order) -> None:
    """Do what the server says."""
    if isinstance(order, Attach):
        session.guarded(0, session.attach)
    elif isinstance(order, Open):
        session.guarded(0, lambda: open_files(session, order))


def open_files(session: Session, order: Open) -> None:
    """Open what was uploaded together: a mesh with its field and edit, or those for the mesh that is open."""
    if order.mesh is not None:
        session.open_shape(order.mesh, field=order.field, edit=order.edit)
        return
    if order.field is not None:
        session.open_field(order.field)
    if order.edit is not None:
        session.open_edit(order.edit)


def _limit_memory(most: int | None) -> None:
    """Let what asks for more than `most` bytes fail as a `MemoryError`, where the system can tell."""
    if most is None or sys.platform == "win32":
        return
    import resource

    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


if __name__ == "__main__":
    main()
