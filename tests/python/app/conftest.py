"""A small shape with a field, and a server that shows it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from app_page import Page, Shape
from tiny_encoder import save_tiny_encoder

import dfd
from dfd.app.coarse import MOST_FACES
from dfd.app.launch import RunningApp
from dfd.app.options import OpenedFile, SessionOptions, Source
from dfd.editing.deformer import Deformer
from dfd.field.field import Field

SETTINGS = {"views": 4, "resolution": 64, "steps": 40, "batch": 64, "smoothing": 0.0}


@pytest.fixture(scope="session")
def shape(tmp_path_factory: pytest.TempPathFactory) -> Shape:
    return _distilled(tmp_path_factory.mktemp("shape"), "chair", dfd.samples.chair(4000), SETTINGS)


@pytest.fixture(scope="session")
def animal(tmp_path_factory: pytest.TempPathFactory) -> Shape:
    """One whose hooves look alike to its field."""
    sample = dfd.samples.quadruped(4000)
    made = _distilled(tmp_path_factory.mktemp("animal"), "quadruped", sample, {**SETTINGS, "steps": 300})
    return replace(made, alike=tuple(sample.vertices_of("hoof").tolist()))


@pytest.fixture(scope="session")
def large(animal: Shape, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same animal with so many faces that it has a coarse level."""
    path = tmp_path_factory.mktemp("large") / "large.ply"
    dfd.samples.quadruped(3 * MOST_FACES).mesh.save(path)
    return path


def _distilled(folder: Path, name: str, sample: dfd.samples.Sample, settings: dict[str, Any]) -> Shape:
    encoder = save_tiny_encoder(folder / "encoder")
    mesh, field = folder / f"{name}.glb", folder / f"{name}.field.safetensors"
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    sample.mesh.save(mesh)
    dfd.distill(dfd.load(mesh), encoder, **settings, progress=False, cache=False).save(field)
    torch.set_num_threads(threads)
    return Shape(mesh, field, encoder, settings)


@pytest.fixture(scope="session")
def static(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Something in place of the built page."""
    folder = tmp_path_factory.mktemp("static")
    (folder / "index.html").write_text("<!doctype html><title>dfd</title>")
    (folder / "assets").mkdir()
    (folder / "assets" / "index-1a2b.js").write_text("export {}")
    return folder


@pytest.fixture(scope="session")
def options(shape: Shape) -> SessionOptions:
    return SessionOptions(
        mesh=Source(name="chair.glb", path=shape.mesh),
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
    """A tab, its shape alive, that the tests of a module share: a session takes seconds to begin."""
    shared = Page(app)
    shared.open()
    shared.alive()
    yield shared
    shared.close()


@pytest.fixture
def page(tab: Page) -> Page:
    """The shared tab, nothing in hand."""
    tab.ask("clear")
    tab.heard[:] = [message for message in tab.heard if message["type"] in ("mesh", "state", "columns")]
    return tab


@pytest.fixture
def new_page(app: RunningApp) -> Iterator[Page]:
    """A tab of its own, its shape alive."""
    own = Page(app)
    own.open()
    own.alive()
    yield own
    own.close()


@pytest.fixture
def deformer(shape: Shape) -> Deformer:
    mesh = dfd.load(shape.mesh)
    return Deformer(mesh, Field.load(shape.field))
