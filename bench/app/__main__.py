"""Measure the app: `python -m bench.app [--faces 1000000] [--tabs 16] [--only server|page]`.

The server is measured from a page's side, over loopback, and the page in Chromium on software GL, both with a field of
random numbers: no figure depends on what a field says. Times are medians of several runs where a run is short.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

import dfd
from bench.app import page
from dfd.app.options import OpenedFile, SessionOptions, Source
from dfd.app.protocol.answers import VERSION
from dfd.app.web.launch import RunningApp
from dfd.field.architecture import Architecture
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh

REPEATS = 9
LARGEST_SAMPLE = 100_000  # faces
DRAGGED = 50_000  # faces of the shape whose frames are counted
PATIENCE = 600.0


class Tab:
    """A page that measures."""

    def __init__(self, app: RunningApp, stack: ExitStack) -> None:
        self._socket: ClientConnection = stack.enter_context(
            connect(
                f"ws://127.0.0.1:{app.port}/ws",
                origin=Origin(f"http://127.0.0.1:{app.port}"),
                additional_headers={"Cookie": f"{app.rules.cookie}={app.rules.token}"},
                max_size=None,
                compression=None,
                proxy=None,
            )
        )
        self.bytes_in = self.bytes_out = 0
        self._count = 0

    def say(self, kind: str, **fields: Any) -> int:
        """Send a request."""
        self._count += 1
        text = json.dumps({"type": kind, "id": self._count, **fields})
        self.bytes_out += len(text)
        self._socket.send(text)
        return self._count

    def hear(self) -> dict[str, Any]:
        """The header of the next message."""
        data = self._socket.recv(timeout=PATIENCE)
        self.bytes_in += len(data)
        if isinstance(data, bytes):
            data = data[4 : 4 + int.from_bytes(data[:4], "little")].decode()
        return json.loads(data)

    def until(self, **wanted: Any) -> dict[str, Any]:
        """The next message that has these."""
        while True:
            message = self.hear()
            if message["type"] == "failure":
                raise RuntimeError(message["message"])
            if all(message.get(key) == value for key, value in wanted.items()):
                return message

    def alive(self) -> None:
        """Wait until the shape has its field."""
        while self.until(type="state")["field"]["status"] != "ready":
            pass


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--faces", type=int, default=1_000_000)
    parser.add_argument("--tabs", type=int, default=16)
    parser.add_argument("--only", choices=("server", "page"))
    options = parser.parse_args()
    if options.only != "page":
        _server(options.faces, options.tabs)
    if options.only != "server":
        _page(options.faces)


def _page(faces: int) -> None:
    lacking = page.missing()
    if lacking is not None:
        Console().print(f"The page was not measured: {lacking} is missing.")
        return
    for count, drag in ((DRAGGED, True), (faces, False)):
        with _stored(count) as (options, title):
            table = Table("figure of the page", "value", title=title)
            page.measure(options, table, drag=drag)
            Console().print(table)


def _server(faces: int, tabs: int) -> None:
    with _stored(faces) as (options, title), tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        (Path(folder) / "index.html").write_text("")
        table = Table("figure", "value", title=title)
        app = RunningApp(SessionOptions(), static=Path(folder))
        app.start()
        stack.callback(app.stop)
        time.sleep(10)  # until the first process waits for its tab
        app.tabs.options = options
        _one_tab(app, stack, table)
        app.tabs.options = SessionOptions(mesh=Source(name="shape", sample="chair"), field=options.field)
        _many_tabs(app, tabs, stack, table)
        Console().print(table)


@contextmanager
def _stored(faces: int) -> Iterator[tuple[SessionOptions, str]]:
    """A shape and its field in files, as the app opens them; and what to call it."""
    with tempfile.TemporaryDirectory() as folder:
        mesh = _mesh(faces)
        path, field = Path(folder) / "shape.ply", Path(folder) / "shape.field.safetensors"
        mesh.save(path)
        _field(mesh).save(field)
        options = SessionOptions(mesh=Source(name="shape.ply", path=path), field=OpenedFile(name="field", path=field))
        yield options, f"{len(mesh.faces):,} faces, {len(mesh.vertices):,} vertices"


def _mesh(faces: int) -> Mesh:
    """A chair, of a large one the faces split until there are as many as wanted."""
    if faces <= LARGEST_SAMPLE:
        return dfd.samples.chair(faces).mesh
    mesh = dfd.samples.chair(20_000).mesh
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    while 4 * len(triangles) <= 2 * faces:
        import trimesh

        vertices, triangles = trimesh.remesh.subdivide(vertices, triangles)
    return Mesh(vertices, triangles)


def _field(mesh: Mesh) -> Field:
    """A field of random numbers, as large as real ones."""
    random = np.random.default_rng(0)
    shapes = Architecture(384, octaves=5).shapes()
    return Field(
        {name: random.standard_normal(shape, np.float32) / np.sqrt(shape[-1]) for name, shape in shapes.items()},
        octaves=5,
        center=mesh.bounds.mean(axis=0),
        scale=2 / float(mesh.extents.max()),
    )


def _one_tab(app: RunningApp, stack: ExitStack, table: Table) -> None:
    tab = Tab(app, stack)
    start = time.perf_counter()
    session = tab.say("hello", version=VERSION)
    name = tab.until(id=session)["session"]
    tab.until(type="progress", stage="done")
    read = time.perf_counter()
    tab.until(type="mesh")
    shown = time.perf_counter()
    table.add_row("opening the file", f"{read - start:.2f} s")
    table.add_row("mesh to page, once the server has it", f"{shown - read:.2f} s ({tab.bytes_in / 1e6:.1f} MB)")
    tab.alive()
    table.add_row("features of all vertices", f"{time.perf_counter() - shown:.2f} s")
    tab.until(type="state")  # with the planes of symmetry, which are searched in the background
    table.add_row(
        "rest over the surface to heat map", _median(lambda i: tab.until(id=tab.say("probe", at={"vertex": i})))
    )

    def click(i: int) -> None:
        tab.say("add", at={"vertex": 1000 + i}, transform={"translation": [0, 0.1, 0]})
        tab.until(type="state")

    table.add_row("click to heat map, one right after another", _median(click))
    tab.until(type="done", id=tab._count)
    tab.until(id=tab.say("move", handle=1, transform={"translation": [0.0, 0.1, 0.0]}))
    sent, received = tab.bytes_out, tab.bytes_in
    frames = 200
    start = time.perf_counter()
    for i in range(frames):
        parts = {"translation": [i / 7, i / 3, 0.1], "rotation": [i / 11, 0.1, 0.7], "scale": [1.1, 1.2, 1.3]}
        tab.until(id=tab.say("move", handle=1, transform=parts, merge=True))
    took = time.perf_counter() - start
    size = (tab.bytes_out - sent + tab.bytes_in - received) / frames
    table.add_row("a frame of a drag, over the wire", f"{size:.0f} bytes, {1000 * took / frames:.1f} ms there and back")
    table.add_row("positions from the kernel", _median(lambda i: tab.until(id=tab.say("compute"))))
    found = app.tabs.find(name)
    pid = getattr(getattr(found, "link", None), "pid", None)
    table.add_row("memory of the session", f"{_memory(pid) / 1e6:.0f} MB")


def _many_tabs(app: RunningApp, count: int, stack: ExitStack, table: Table) -> None:
    start = time.perf_counter()
    tabs = [Tab(app, stack) for _ in range(count)]
    for tab in tabs:
        tab.say("hello", version=VERSION)
    for tab in tabs:
        tab.alive()
    table.add_row(f"{count} tabs more, all alive", f"{time.perf_counter() - start:.1f} s")

    def everyone(i: int) -> None:
        numbers = [tab.say("probe", at={"vertex": i}) for tab in tabs]
        for tab, number in zip(tabs, numbers, strict=True):
            tab.until(id=number)

    table.add_row(f"a heat map for each of {count} tabs at once", _median(everyone))
    pids = [getattr(getattr(tab, "link", None), "pid", None) for tab in app.tabs.all()]
    table.add_row("memory of all sessions", f"{sum(map(_memory, pids)) / 1e6:.0f} MB")


def _median(run: Any) -> str:
    times = []
    for i in range(REPEATS):
        start = time.perf_counter()
        run(i)
        times.append(1000 * (time.perf_counter() - start))
    return f"{statistics.median(times):.0f} ms ({min(times):.0f} … {max(times):.0f})"


def _memory(pid: int | None) -> int:
    """Resident bytes of a process that nobody else has, where the system tells."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return sum(1024 * int(line.split()[1]) for line in lines if line.startswith("Private_"))


if __name__ == "__main__":
    main()
