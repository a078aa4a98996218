"""The demo: two made shapes, their real features, three edits each, and one sheet that tells the story."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from dfd import samples
from dfd.common.linear_algebra import Float32, Float64, Int64, UInt8
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.distill import distill
from dfd.distillation.settings import DistillSettings
from dfd.editing.deformer import Deformer
from dfd.encoders.encode import Encoder, load_encoder
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.pictures.colors import feature_colors
from dfd.pictures.contact_sheet import contact_sheet, heat_bar
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import session_views
from dfd.symmetry.plane import axis_name
from dfd.symmetry.search import symmetry_planes
from dfd.views.render import render

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.samples import Sample

Picture = tuple[UInt8, str]
Row = tuple[str, Sequence[Picture]]


def run(
    output: Path,
    *,
    preset: Preset = "default",
    encoder: str = DEFAULT_ENCODER,
    faces: int = 20_000,
    console: Console | None = None,
) -> None:
    """Make a chair and a quadruped, distill them, deform them, and write meshes and pictures into `output`.

    `story.png` tells everything from the views to the moved shapes; `opening.png` is its shortest form. Each shape has
    about `faces` faces.

    Raises OSError if the folder cannot be written, or the encoder's weights cannot be found.
    """
    console = console or Console()
    output.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    opening: list[Picture] = []
    table = Table("stage", title="Seconds")
    seconds: list[dict[str, float]] = []
    model = load_encoder(encoder, **DistillSettings(preset=preset).of_encoder())
    for name, sample, edits in (
        ("chair", samples.chair(faces), _edit_chair),
        ("quadruped", samples.quadruped(faces), _edit_quadruped),
    ):
        console.print(f"[bold]{name}[/bold]: {len(sample.mesh.faces):,} faces")
        stages = Stages()
        field, features, first = _distill(sample, model, preset, stages)
        field.save(output / f"{name}.field.safetensors")
        sample.mesh.save(output / f"{name}.glb")
        rows.append((f"The {name}: what the encoder sees, and its features by color", first))
        with stages.stage("deform and draw"):
            stories = edits(sample, partial(Deformer, sample.mesh, field, preset=preset, features=features), output)
        rows += [story.row() for story in stories]
        opening += [picture for story in stories if story.opens for picture in story.opening()]
        table.add_column(name, justify="right")
        seconds.append(stages.seconds)
    with Stages().stage("sheet"):
        save_png(output / "story.png", contact_sheet(rows, title="Deep feature deformation: grab one, move all alike"))
        save_png(output / "opening.png", contact_sheet([("", opening)], cell=260))
    for stage in seconds[0]:
        table.add_row(stage, *(f"{times[stage]:.1f}" for times in seconds))
    console.print(table)
    console.print(f"Pictures: {output / 'story.png'}, {output / 'opening.png'}\nMeshes:   {output}")


def _distill(sample: Sample, model: Encoder, preset: Preset, stages: Stages) -> tuple[Field, Float32, list[Picture]]:
    mesh = sample.mesh
    field = distill(mesh, model, progress=stages, cache=False, preset=preset)
    with stages.stage("symmetry"):
        planes = symmetry_planes(field, mesh)
    found = ", ".join(f"{axis_name(plane.normal)} ({plane.score:.2f})" for plane in planes) or "none"
    views = render(mesh, views=24, resolution=320)
    pictures = [(views.images[index], f"view {index + 1} of 24") for index in (6, 9, 16)]
    features = field.features(mesh)
    colors = feature_colors(features)
    pictures += [
        (picture(mesh, colors=colors, azimuth=35), "features"),
        (picture(mesh, colors=colors, azimuth=215), f"features, behind; mirror plane found: {found}"),
    ]
    return field, features, pictures


def _edit_chair(sample: Sample, session: Callable[[], Deformer], output: Path) -> list[_Story]:
    mesh = sample.mesh
    foot = _lowest(mesh.vertices, sample.vertices_of("leg", 0))
    back = _highest(mesh.vertices, sample.vertices_of("back"))
    legs = session()
    legs.add(foot, translation=(0.0, -0.35, 0.0), name="foot")
    tall = session()
    tall.add(back, scale=(1.0, 1.5, 1.0), translation=(0.0, 0.12, 0.0), name="back")
    return [
        _Story("One foot of the chair is pulled down: all four legs grow", legs, output / "chair_legs", "one foot"),
        _Story("The top of its back is pulled up", tall, output / "chair_back"),
    ]


def _edit_quadruped(sample: Sample, session: Callable[[], Deformer], output: Path) -> list[_Story]:
    mesh = sample.mesh
    hoof = _lowest(mesh.vertices, sample.vertices_of("hoof", 0))
    horn = _highest(mesh.vertices, sample.vertices_of("horn", 0))
    root = mesh.vertices[_lowest(mesh.vertices, sample.vertices_of("horn", 0))]
    head = sample.vertices_of("head")
    muzzle = int(head[np.argmax(mesh.vertices[head, 2])])

    def bent(locality: float = 0.0) -> Deformer:
        horns = session()
        horns.add(horn, rotation=(-50.0, 0.0, 0.0), scale=1.4, pivot=root, locality=locality, name="horn")
        return horns

    legs = session()
    legs.add(hoof, translation=(0.0, -0.3, 0.0), name="hoof")
    held = bent()
    held.fix(muzzle)
    return [
        _Story("One hoof is pulled down: all four legs grow", legs, output / "quadruped_legs", "one hoof"),
        _Story("One horn is bent: what looks alike follows", bent(), output / "quadruped_horn"),
        _Story("The same with locality 6: it stays near", bent(6.0), output / "quadruped_horn_local"),
        _Story(
            "The same with a fixed point on the muzzle: the head holds",
            held,
            output / "quadruped_horn_fixed",
            "one horn",
        ),
    ]


class _Story:
    """One edit: its mesh and document on disk, and its pictures.

    With `opens`, what its handle is on, it is one of those that the opening picture shows.
    """

    def __init__(self, title: str, deformer: Deformer, stem: Path, opens: str = "") -> None:
        self.title, self.opens = title, opens
        deformer.mesh.save(stem.with_suffix(".glb"), deformer.vertices)
        deformer.save(stem.with_suffix(".json"))
        self._mesh, self._views = deformer.mesh, session_views(deformer, 35.0)

    def row(self) -> Row:
        """Weights, before and after, from both sides."""
        shown = [("weights", 35.0, "weights"), ("weights", 215.0, "weights, behind"), ("before", 35.0, "before")]
        shown += [("after", 35.0, "after"), ("after", 215.0, "after, behind")]
        cells = [(self._view(name, azimuth), caption) for name, azimuth, caption in shown]
        return self.title, [*cells[:2], (heat_bar(512), ""), *cells[2:]]

    def opening(self) -> list[Picture]:
        """Weights and what came of them."""
        return [(self._view("weights"), f"{self.opens} held: weights"), (self._view("after"), "")]

    def _view(self, name: str, azimuth: float = 35.0) -> UInt8:
        return picture(self._mesh, **{**self._views[name], "azimuth": azimuth})


def _lowest(vertices: Float64, among: Int64) -> int:
    return int(among[np.argmin(vertices[among, 1])])


def _highest(vertices: Float64, among: Int64) -> int:
    return int(among[np.argmax(vertices[among, 1])])
