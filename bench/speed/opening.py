"""`python -m bench.speed.opening`: time what a user waits for in the app, from opening a mesh to the first color.

The mesh is a quadruped, without a field in the cache. Each row gives seconds since it was
opened: until the page gets the mesh, until parts of the geometry can be grabbed, until the first color, and until the
features are learned. The last columns are the seconds of a color and of a click after that.
"""

import argparse
import json
import os
import queue
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import dfd

SIZES = (10_000, 100_000, 1_500_000)  # faces
COLUMNS = ("mesh", "grabbable", "first color", "learned", "next color", "click")
PATIENCE = 600.0  # seconds


class Client:
    """A session without a web server: its messages and its work are queued, and done on this thread."""

    def __init__(self, folder: Path, options: Any) -> None:
        from dfd.app.session.session import Session

        self._work: queue.Queue[Callable[[], object]] = queue.Queue()
        self.heard: list[dict[str, Any]] = []
        self._asked = 0
        self.session = Session(folder, options, self._receive, self._work.put)

    def _receive(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            header = json.loads(message[8 : 8 + int.from_bytes(message[:8], "little")])
            message = header["__metadata__"]["message"]
        self.heard.append(json.loads(message))

    def until(self, wanted: Callable[[dict[str, Any]], bool]) -> None:
        """Do queued work until `wanted` accepts a message."""
        end = time.monotonic() + PATIENCE
        while not any(map(wanted, self.heard)):
            self._work.get(timeout=max(end - time.monotonic(), 0.0))()

    def ask(self, kind: str, **fields: Any) -> float:
        """Answer a request, and return the seconds that it took."""
        from dfd.app.protocol.requests import read_request
        from dfd.app.session.requests import answer

        self._asked += 1
        began = time.perf_counter()
        answer(self.session, read_request(json.dumps({"type": kind, "id": self._asked, **fields})))
        return time.perf_counter() - began


def seconds(faces: int) -> dict[str, float]:
    """Return the seconds of each of `COLUMNS` for a mesh of about `faces` faces."""
    from dfd.app.options import OpenedFile, SessionOptions

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        os.environ |= {"DFD_CACHE": str(folder / "cache"), "DFD_DATA": str(folder / "data")}
        mesh = dfd.samples.quadruped(faces).mesh
        mesh.save(folder / "shape.ply")
        client = Client(folder, SessionOptions(mesh=OpenedFile("shape.ply", folder / "shape.ply")))
        began = time.perf_counter()
        row: dict[str, float] = {"faces": float(len(mesh.faces))}

        def reached(name: str, wanted: Callable[[dict[str, Any]], bool]) -> None:
            client.until(wanted)
            row[name] = time.perf_counter() - began

        client.session.begin()
        reached("mesh", lambda message: message["type"] == "mesh")
        reached("grabbable", lambda message: message["type"] == "state" and message["field"]["status"] == "ready")
        client.ask("probe", vertex=0)
        row["first color"] = time.perf_counter() - began
        reached("learned", lambda message: message["type"] == "state" and message["field"]["origin"] == "distilled")
        row["next color"] = client.ask("probe", vertex=7)
        row["click"] = client.ask("add", at=int(mesh.vertices[:, 1].argmin()))
        client.session.close_shape()
    return row


def main() -> None:
    """Measure all sizes and print a table."""
    from bench.tables import to_markdown  # asv imports this module from another folder

    parser = argparse.ArgumentParser(prog="python -m bench.speed.opening", description=__doc__)
    parser.add_argument("--faces", type=int, nargs="+", default=SIZES, help="default: %(default)s")
    rows = [seconds(faces) for faces in parser.parse_args().faces]
    print(
        to_markdown(
            ["faces", *(f"{name}, s" for name in COLUMNS)],
            [[int(row["faces"]), *(row[name] for name in COLUMNS)] for row in rows],
        )
    )


if __name__ == "__main__":
    main()
