"""Run the code on the pages, and insert its output and pictures.

All `python` code blocks of a page share their variables. In `sh` code blocks, the lines that begin with `dfd` run as
commands. Each page runs in an empty folder of its own. If Python and a command write the same mesh file, its vertices
must be equal. A warning is an error. The build replaces these lines:

    <!-- output -->        the output of the code block above
    <!-- draw NAME -->     pictures of the page's variable NAME, which a code block above or below defines. A session
                           gives pictures before and after the edit, and a picture of the weights. A dict maps captions
                           to sessions, pictures, or pairs of a mesh and options of the function `picture`.
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging
from typer.testing import CliRunner

import dfd
from dfd.cli import app as command_line
from dfd.pictures.picture import picture
from dfd.pictures.sheet import session_views
from dfd.pictures.viewpoint import azimuth_towards

BUILD = Path(__file__).resolve().parents[2] / "build" / "docs"
FILES, PICTURES = BUILD / "files", BUILD / "pictures"  # FILES has a folder for each page
STEP = re.compile(r"^```(python|sh)\n(.*?)^```$|^<!-- (output|draw)(?: (\w+))? -->$", re.MULTILINE | re.DOTALL)
LATER = re.compile(r"^<!-- draw (\w+) -->$", re.MULTILINE)  # draws a variable that a later code block defines
RESOLUTION = 360
MARKS = ("handles", "fixed", "labels")  # the options of `picture` that draw marks
TOLERANCE = 1e-4  # positions count as equal up to this fraction of the box's diagonal, because files store float32
MARGIN = 6  # pixels around the shapes in a row of pictures
# The pages of this folder show sessions of both presets on one field, which causes this warning.
COMPARED, OTHER_PRESET = "how_it_works", "Deformer: `preset` is 'paper', but the field"
LAST = "how_to/index"  # the page that shows pictures of other pages

Cell = tuple[str, list[NDArray[np.uint8]]]  # a caption, and pictures from top to bottom
log = logging.getLogger(__name__)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the functions that run the code when Sphinx reads a page."""
    app.connect("builder-inited", _make_folders)
    app.connect("env-before-read-docs", _show_last)
    app.connect("source-read", _run_page)
    return {"parallel_read_safe": False, "parallel_write_safe": True}


def _make_folders(app: Sphinx) -> None:
    FILES.mkdir(parents=True, exist_ok=True)
    PICTURES.mkdir(exist_ok=True)


def _show_last(app: Sphinx, env: BuildEnvironment, names: list[str]) -> None:
    """Let Sphinx read the page `LAST` last."""
    names.sort(key=LAST.__eq__)


def _run_page(app: Sphinx, name: str, source: list[str]) -> None:
    if app.builder.name == "linkcheck" or not STEP.search(source[0]):
        return
    start = time.perf_counter()
    source[0] = _Page(name).run(source[0])
    log.info(" [%.1f s]", time.perf_counter() - start, nonl=True)


class _Page:
    """Runs the code of one page, and replaces the lines `<!-- output -->` and `<!-- draw NAME -->`."""

    def __init__(self, name: str) -> None:
        self.name, self.namespace = name, {"__name__": name}
        self.printed, self.drawn = "", 0
        self.folder = FILES / name.replace("/", "-")

    def run(self, text: str) -> str:
        """Return the text of the page after its code has run."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        with contextlib.chdir(self.folder), warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)
            if self.name.startswith(COMPARED):
                warnings.filterwarnings("ignore", OTHER_PRESET, UserWarning)
            text = STEP.sub(self._step, text)
            return LATER.sub(lambda mark: self._draw(self.namespace[mark[1]]), text)

    def _step(self, step: re.Match[str]) -> str:
        language, code, mark, variable = step.groups()
        try:
            if language == "python":
                with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.redirect_stderr(io.StringIO()):
                    exec(compile(code, self.name, "exec"), self.namespace)
                self.printed = printed.getvalue()
            elif language == "sh":
                self.printed = "".join(map(self._command, code.replace("\\\n", "").splitlines()))
            elif mark == "output":
                return f"```{{code-block}} text\n:class: output\n\n{self.printed.rstrip()}\n```"
            elif variable in self.namespace:
                return self._draw(self.namespace[variable])
        except Exception as error:
            log.warning("%r in\n%s", error, step[0], location=self.name)
        return step[0]

    def _command(self, line: str) -> str:
        """Run `line` of an `sh` code block if it begins with `dfd`, and return the output of the command."""
        words = shlex.split(line, comments=True)
        if not words or words[0] != "dfd":
            return ""
        files = [*self.folder.glob("*.glb"), *self.folder.glob("*.obj")]
        before = {file: (file.stat().st_mtime_ns, dfd.load(file).vertices) for file in files}
        result = CliRunner().invoke(command_line, words[1:])
        if result.exit_code:
            raise RuntimeError(f"exit code {result.exit_code}: {result.output} {result.exception!r}")
        for file, (written, vertices) in before.items():
            if file.stat().st_mtime_ns != written:
                now = dfd.load(file)
                if np.abs(now.vertices - vertices).max() > TOLERANCE * now.diagonal:
                    raise RuntimeError(f"{file.name} differs from the file that Python wrote")
        return "".join(f"{line}\n" for line in result.output.splitlines() if "━" not in line)

    def _draw(self, value: Any) -> str:
        cells = _cells(value)
        inked = np.any([image[..., 3] > 0 for _, images in cells for image in images], axis=0)
        sides = (np.flatnonzero(inked.any(axis=axis)) for axis in (1, 0))
        crop = tuple(slice(max(each[0] - MARGIN, 0), each[-1] + MARGIN) for each in sides)
        count = len(cells)
        lines = [f"::::{{grid}} 2 {min(3, count)} {count} {count}", ":gutter: 1", ":class-container: strip"]
        for caption, images in cells:
            self.drawn += 1
            path = PICTURES / f"{self.name.replace('/', '-')}-{self.drawn}.png"
            Image.fromarray(np.concatenate([image[crop] for image in images])).save(path, optimize=True)
            at = os.path.relpath(path, Path(__file__).parents[1] / Path(self.name).parent)
            lines += [":::{grid-item}", f"![{caption}]({at})", "", caption, ":::"]
        return "\n".join([*lines, "::::"])


def _cells(value: Any) -> list[Cell]:
    """Return captions with pictures: three for a session, or one for each entry of a dict.

    A session in a dict has two pictures: its weights, and its result.
    """
    if isinstance(value, dfd.Deformer):
        stages = zip(("before", "what follows", "after"), _views(value, [value]).values(), strict=True)
        return [(caption, [_transparent(value.mesh, **view)]) for caption, view in stages]
    sessions = [each for each in value.values() if isinstance(each, dfd.Deformer)]
    drawn: list[Cell] = []
    for caption, each in value.items():
        if isinstance(each, dfd.Deformer):
            views = _views(each, sessions)
            drawn.append((caption, [_transparent(each.mesh, **views[name]) for name in ("weights", "after")]))
        elif isinstance(each, np.ndarray):
            drawn.append((caption, [np.dstack([each, np.full(each.shape[:2], 255, np.uint8)])]))
        else:
            mesh, options = each
            drawn.append((caption, [_transparent(mesh, **options)]))
    return drawn


def _views(session: dfd.Deformer, sessions: list[dfd.Deformer]) -> dict[str, dict[str, Any]]:
    """Return the options of `picture` for each stage of `session`, with a camera that fits all `sessions`."""
    mesh = sessions[0].mesh
    places = np.array([handle.place.position for each in sessions for handle in each.handles]).reshape(-1, 3)
    # The camera faces the handles, but stays within 45° of the front, where viewers recognize a shape.
    azimuth = float(np.clip((azimuth_towards(mesh, places) + 180) % 360 - 180, -45, 45))
    frame = [mesh.vertices, *(each.vertices for each in sessions)]
    return {name: {**view, "frame": frame} for name, view in session_views(session, azimuth).items()}


def _transparent(mesh: dfd.Mesh, **options: Any) -> NDArray[np.uint8]:
    """Return a picture (R, R, 4) with a transparent background, for pages with a dark background.

    The shape is opaque. Outside the shape, the opacity of a pixel is 1 minus its smallest color channel (0 to 1).
    """
    options = {"resolution": RESOLUTION, **options}
    image = picture(mesh, **options) / np.float32(255)
    shape_options = {name: value for name, value in options.items() if name not in ("colors", "weights", *MARKS)}
    black = picture(mesh, colors=np.zeros((len(mesh.vertices), 3)), **shape_options) / np.float32(255)
    alpha = 1 - np.minimum(black, image).min(axis=2, keepdims=True)
    color = (image - (1 - alpha)) / np.maximum(alpha, 1e-3)
    return (np.dstack([color, alpha]).clip(0, 1) * 255 + 0.5).astype(np.uint8)
