"""The page's own figures, in Chromium on software GL, where that and Node are found."""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
from pathlib import Path
from typing import Any

from rich.table import Table

from dfd.app.options import SessionOptions
from dfd.app.web.launch import RunningApp
from dfd.app.web.server import STATIC

CLIENT = Path(__file__).parents[2] / "python" / "dfd" / "app" / "client"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
MINUTES = 8


def missing() -> str | None:
    """What is not here of what the page is measured with; None where all is."""
    if shutil.which("node") is None or not (CLIENT / "node_modules" / "playwright-core").is_dir():
        return "Node with the client's packages (npm ci)"
    if not (STATIC / "index.html").is_file():
        return "the built page (npm run build)"
    return None if any(map(shutil.which, BROWSERS)) else "Chromium or Chrome"


def measure(options: SessionOptions, table: Table, *, drag: bool) -> None:
    """Add the figures of the page that opens what `options` say: of frames, or of waiting and memory."""
    app = RunningApp(options)
    app.start()
    try:
        ways: dict[str, list[str]] = {"SwiftShader": []}
        if drag and shutil.which("xvfb-run"):
            ways["llvmpipe"] = ["xvfb-run", "-a", "-s", "-screen 0 1600x1000x24"]
        for name, before in ways.items():
            (_drag if drag else _wait)(table, name, _page(app, before, drag=drag))
    finally:
        app.stop()


def _page(app: RunningApp, before: list[str], *, drag: bool) -> dict[str, Any]:
    browser = next(filter(None, map(shutil.which, BROWSERS)))
    environment = {
        **os.environ,
        "DFD_URL": app.url,
        "DFD_CLIENT": str(CLIENT),
        "DFD_CHROMIUM": str(browser),
        "DFD_GL": "gl" if before else "swiftshader",
        "DFD_DRAG": "yes" if drag else "no",
    }
    command = [*before, "node", str(Path(__file__).with_suffix(".mjs"))]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60 * MINUTES, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr[-2000:])
    return json.loads(done.stdout.splitlines()[-1])


def _drag(table: Table, name: str, found: dict[str, Any]) -> None:
    if not found["moved"]:
        raise RuntimeError("The gizmo was missed: nothing was dragged")
    for key, words in (("rest", "at rest"), ("drag", "in a drag")):
        frames = found[key]
        text = f"{frames['fps']:.1f} a second, {frames['milliseconds']:.0f} ms of processors each"
        table.add_row(f"frames {words}, {name}", f"{text} (load {found['load']:.1f})")
    table.add_row(f"a frame of a drag over the wire, {name}", f"{found['bytes']:.0f} bytes")


def _wait(table: Table, name: str, found: dict[str, Any]) -> None:
    for key, words in (
        ("shown", "the shape is seen"),
        ("answered", "the point under the pointer is found"),
        ("whole", "it has its features and is drawn whole"),
    ):
        table.add_row(f"from mesh in the server until {words}, {name}", f"{found[key] / 1000:.2f} s")
    for key, words in (("there", "its column is in the page"), ("drawn", "it is drawn in software")):
        times = [click[key] for click in found["clicks"]]
        text = f"{statistics.median(times):.0f} ms ({min(times):.0f} … {max(times):.0f})"
        table.add_row(f"from click until {words}", f"{text} (load {found['load']:.1f})")
    own, empty = found["memory"], found["empty"]
    table.add_row("memory of the tab", f"{own['renderer']:.0f} MB, of JavaScript's heap {found['heap']:.0f} MB")
    drawing = own["gpu-process"] - empty.get("gpu-process", 0)
    table.add_row("memory of graphics", f"{own['gpu-process']:.0f} MB, {drawing:.0f} more than without a page")
