"""Fixtures: small shapes with fields, and servers that show them."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from app_page import CLIENT, Page, Shape

import dfd
from dfd.app.options import OpenedFile, SessionOptions
from dfd.app.web.launch import RunningApp
from dfd.app.web.server import STATIC
from dfd.editing.deformer import Deformer
from dfd.field.field import Field
from dfd.samples import Sample

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
SETTINGS = {"views": 4, "resolution": 64, "steps": 40, "batch": 64, "smoothing": 0.0}


Distill = Callable[[str, Sample, dict[str, Any]], Shape]


@pytest.fixture(scope="session")
def distilled(made_once: Callable[..., Path], tiny_encoder: Path) -> Distill:
    """Return a function that saves a sample under a name, distills its field, and returns both as a `Shape`."""

    def distilled(name: str, sample: Sample, settings: dict[str, Any]) -> Shape:
        def make(folder: Path) -> None:
            threads = torch.get_num_threads()
            torch.set_num_threads(1)
            sample.mesh.save(folder / f"{name}.glb")
            field = dfd.distill(folder / f"{name}.glb", tiny_encoder, **settings, progress=False, cache=False)
            field.save(folder / f"{name}.field.safetensors")
            torch.set_num_threads(threads)

        folder = made_once(name, make)
        return Shape(folder / f"{name}.glb", folder / f"{name}.field.safetensors", tiny_encoder, settings)

    return distilled


@pytest.fixture(scope="session")
def shape(distilled: Distill, chair_sample: Sample) -> Shape:
    return distilled("chair", chair_sample, SETTINGS)


@pytest.fixture(scope="session")
def animal(distilled: Distill, quadruped_sample: Sample) -> Shape:
    """Return a quadruped with a field that gives its hooves similar features."""
    made = distilled("quadruped", quadruped_sample, {**SETTINGS, "steps": 300})
    return replace(made, alike=tuple(quadruped_sample.vertices_of("hoof").tolist()))


@pytest.fixture(scope="session")
def large(made_once: Callable[..., Path]) -> Path:
    """Return the mesh file of a quadruped with many faces."""
    make = lambda folder: dfd.samples.quadruped(48_000).mesh.save(folder / "large.ply")  # noqa: E731
    return made_once("large", make) / "large.ply"


@pytest.fixture(scope="session")
def static(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a small page in place of the built page."""
    folder = tmp_path_factory.mktemp("static")
    (folder / "index.html").write_text("<!doctype html><title>dfd</title>")
    (folder / "assets").mkdir()
    (folder / "assets" / "index-1a2b.js").write_text("export {}")
    (folder / "assets" / "large-3c4d.js").write_text("export const numbers = [];\n" * 1000)
    return folder


@pytest.fixture(scope="session")
def browser() -> str:
    """Return the path of a browser, or skip the test with the reason why it cannot run."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if shutil.which("node") is None:
        pytest.skip("Node is not installed: the page was not tested in a browser")
    if not (CLIENT / "node_modules" / "playwright-core").is_dir():
        pytest.skip("the client's packages are not installed (npm ci): the page was not tested in a browser")
    if not (STATIC / "index.html").is_file():
        pytest.skip("the page is not built (npm run build): it was not tested in a browser")
    if found is None:
        pytest.skip("neither Chromium nor Chrome is installed: the page was not tested in a browser")
    return found


@pytest.fixture(scope="session")
def options(shape: Shape) -> SessionOptions:
    return SessionOptions(
        mesh=OpenedFile(name="chair.glb", path=shape.mesh),
        field=OpenedFile(name="chair.field.safetensors", path=shape.field),
        encoder=str(shape.encoder),
        distill={**shape.settings, "cache": False},
    )


@pytest.fixture(scope="module")
def app(options: SessionOptions, static: Path) -> Iterator[RunningApp]:
    running = RunningApp(options, static=static)
    running.start()
    yield running
    running.stop()


@pytest.fixture(scope="module")
def tab(app: RunningApp) -> Iterator[Page]:
    """Return a tab that has found its parts. The tests of a module share it, because a session starts in seconds."""
    shared = Page(app)
    shared.open()
    shared.alive()
    yield shared
    shared.close()


@pytest.fixture
def page(tab: Page) -> Page:
    """Return the shared tab without handles, fixed points and symmetry."""
    tab.ask("clear")
    tab.ask("set_symmetry", plane=None)
    tab.heard[:] = [message for message in tab.heard if message["type"] in ("mesh", "state", "columns")]
    return tab


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a new folder for kept edits."""
    monkeypatch.setenv("DFD_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture
def new_page(app: RunningApp, data: Path) -> Iterator[Page]:
    """Return a new tab with its own session, whose shape has a field and no kept edit."""
    own = Page(app, session="unknown")
    own.open()
    own.alive()
    yield own
    own.close()


@pytest.fixture
def deformer(shape: Shape) -> Deformer:
    mesh = dfd.load(shape.mesh)
    return Deformer(mesh, Field.load(shape.field))
