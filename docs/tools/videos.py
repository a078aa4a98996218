"""Short films of the app's gestures, made by the build: `<!-- video NAME: WHAT IT SHOWS -->` on a page is one of them.

The app itself is played in Chromium by `videos.mjs`. Where that is missing the build says so, and the pages have none.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import av
from PIL import Image
from sphinx.application import Sphinx

from bench.app.page import BROWSERS, CLIENT, missing
from dfd.app.options import SessionOptions
from dfd.app.web.launch import RunningApp
from dfd.app.web.server import STATIC
from tools.examples import BUILD, FILES

VIDEOS = BUILD / "videos"
SCRIPT = Path(__file__).with_suffix(".mjs")
MARK = re.compile(r"^<!-- video (\w+): (.+) -->$", re.MULTILINE)
PICTURES_A_SECOND = 18
MINUTES = 8


def setup(app: Sphinx) -> dict[str, bool]:
    """Film before the pages are read."""
    app.connect("builder-inited", _film_all)
    app.connect("source-read", _put_in)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _film_all(app: Sphinx) -> None:
    if app.builder.name != "html":
        return
    if lacking := missing():
        print(f"No video is made: {lacking} was not found.")
        return
    made = max(path.stat().st_mtime for path in (SCRIPT, STATIC / "index.html"))
    names = {mark[1] for page in Path(app.srcdir).rglob("*.md") for mark in MARK.finditer(page.read_text("utf-8"))}
    targets = [VIDEOS / f"{name}.webm" for name in sorted(names)]
    stale = [target for target in targets if not target.exists() or target.stat().st_mtime < made]
    if not stale:
        return
    with tempfile.TemporaryDirectory() as folder:
        _play([target.stem for target in stale], folder)
        for target in stale:
            _encode(Path(folder, target.stem), target)
            print(f"{target.name}: {target.stat().st_size // 1000} kB")


def _play(names: list[str], folder: str) -> None:
    """Have the pictures of these films in folders of their names."""
    running = RunningApp(SessionOptions())
    running.start()
    environment = {
        **os.environ,
        "DFD_URL": running.url,
        "DFD_CLIENT": str(CLIENT),
        "DFD_CHROMIUM": next(filter(None, map(shutil.which, BROWSERS))),
        "DFD_SHAPES": str(FILES),
        "DFD_OUT": folder,
        "DFD_FILMS": " ".join(names),
    }
    try:
        subprocess.run(["node", str(SCRIPT)], env=environment, timeout=60 * MINUTES, check=True)
    finally:
        running.stop()


def _encode(pictures: Path, target: Path) -> None:
    """Write a video of pictures, and one of them as what is seen before it plays."""
    paths = sorted(pictures.glob("*.png"))
    options = {"crf": "28", "b": "0", "deadline": "good", "cpu-used": "4"}
    with av.open(str(target), "w") as container:
        stream = container.add_stream("libvpx-vp9", rate=PICTURES_A_SECOND, options=options)
        stream.width, stream.height = Image.open(paths[0]).size
        for path in paths:
            container.mux(stream.encode(av.VideoFrame.from_image(Image.open(path).convert("RGB"))))
        container.mux(stream.encode())
    poster = paths[int((pictures / "poster").read_text("utf-8"))]
    Image.open(poster).convert("RGB").save(target.with_suffix(".webp"), quality=82, method=6)


def _put_in(app: Sphinx, name: str, source: list[str]) -> None:
    static = "../" * name.count("/") + "_static"

    def element(mark: re.Match[str]) -> str:
        video, shows = mark.groups()
        if not (VIDEOS / f"{video}.webm").exists():
            return ""
        width, height = Image.open(VIDEOS / f"{video}.webp").size
        return (
            f'<video class="gesture" src="{static}/{video}.webm" poster="{static}/{video}.webp" width="{width}"'
            f' height="{height}" aria-label="{shows}" muted loop playsinline controls></video>'
        )

    source[0] = MARK.sub(element, source[0])
