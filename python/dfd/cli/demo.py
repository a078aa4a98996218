"""The demo: two made shapes, their features, a few edits of each, and one sheet that shows all of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from dfd import samples
from dfd.common.linear_algebra import Float64, Int64, UInt8
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.distill import distill
from dfd.distillation.settings import DistillSettings
from dfd.editing.deformer import Deformer
from dfd.encoders.encode import load_encoder
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.pictures.colors import feature_colors
from dfd.pictures.contact_sheet import contact_sheet, heat_bar
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import session_views
from dfd.samples import Sample
from dfd.symmetry.plane import axis_name
from dfd.symmetry.search import symmetry_planes
from dfd.views.render import render

Picture = tuple[UInt8, str]
Session = Callable[[], Deformer]
Edit = tuple[str, str, Deformer, str]  # title, name of its files, session, what its handle is on if it opens the story
ASIDE, BEHIND = 35.0, 215.0  # azimuths, degrees


def run(
    output: Path,
    *,
    preset: Preset = "default",
    encoder: str = DEFAULT_ENCODER,
    faces: int = 20_000,
    console: Console | None = None,
) -> None:
    """Make a chair and a quadruped, distill them, deform them, and write meshes and pictures into `output`.

    `story.png` shows everything from the views to the moved shapes, `opening.png` the first edits. Each shape has about
    `faces` faces.

    Raises OSError if the folder cannot be written, or the encoder's weights cannot be found.
    """
    console = console or Console()
    output.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, Sequence[Picture]]] = []
    opening: list[Picture] = []
    table = Table("stage", title="Seconds")
    seconds: list[dict[str, float]] = []
    model = load_encoder(encoder, **DistillSettings(preset=preset).of_encoder())
    shapes = (("chair", samples.chair(faces), _chair), ("quadruped", samples.quadruped(faces), _quadruped))
    for name, sample, edits in shapes:
        mesh, stages = sample.mesh, Stages()
        console.print(f"[bold]{name}[/bold]: {len(mesh.faces):,} faces")
        field = distill(mesh, model, progress=stages, cache=False, preset=preset)
        field.save(output / f"{name}.field.safetensors")
        mesh.save(output / f"{name}.glb")
        with stages.stage("symmetry"):
            planes = symmetry_planes(field, mesh)
        mirrors = ", ".join(f"{axis_name(plane.normal)} ({plane.score:.2f})" for plane in planes) or "none"
        images, features = render(mesh, views=24, resolution=320).images, field.features(mesh)
        colors = feature_colors(features)
        seen = [(images[index], f"view {index + 1} of 24") for index in (6, 9, 16)]
        seen += [(picture(mesh, colors=colors, azimuth=ASIDE), "features")]
        behind = f"features, behind; mirror plane found: {mirrors}"
        seen += [(picture(mesh, colors=colors, azimuth=BEHIND), behind)]
        rows.append((f"The {name}: what the encoder sees, and its features by color", seen))
        with stages.stage("deform and draw"):
            session = partial(Deformer, mesh, field, preset=preset, features=features)
            for title, file, deformer, held in edits(sample, session):
                mesh.save(output / f"{file}.glb", deformer.vertices)
                deformer.save(output / f"{file}.json")
                weights, *rest = _drawn(deformer)
                rows.append((title, [*weights, (heat_bar(512), ""), *rest[0], *rest[1]]))
                if held:
                    opening += [(weights[0][0], f"{held} held: weights"), (rest[1][0][0], "")]
        table.add_column(name, justify="right")
        seconds.append(stages.seconds)
    save_png(output / "story.png", contact_sheet(rows, title="Deep feature deformation: grab one, move all alike"))
    save_png(output / "opening.png", contact_sheet([("", opening)], cell=260))
    for stage in seconds[0]:
        table.add_row(stage, *(f"{times[stage]:.1f}" for times in seconds))
    console.print(table)
    console.print(f"Pictures: {output / 'story.png'}, {output / 'opening.png'}\nMeshes:   {output}")


def _drawn(deformer: Deformer) -> tuple[list[Picture], list[Picture], list[Picture]]:
    """Weights from both sides, the shape before, and the shape after from both sides."""
    views = session_views(deformer, ASIDE)

    def draw(name: str, azimuth: float = ASIDE) -> UInt8:
        options: dict[str, Any] = {**views[name], "azimuth": azimuth}
        return picture(deformer.mesh, **options)

    weights = [(draw("weights"), "weights"), (draw("weights", BEHIND), "weights, behind")]
    return weights, [(draw("before"), "before")], [(draw("after"), "after"), (draw("after", BEHIND), "after, behind")]


def _chair(sample: Sample, session: Session) -> list[Edit]:
    vertices = sample.mesh.vertices
    legs, tall = session(), session()
    legs.add(_lowest(vertices, sample.vertices_of("leg", 0)), translation=(0.0, -0.35, 0.0), name="foot")
    top = _lowest(-vertices, sample.vertices_of("back"))
    tall.add(top, scale=(1.0, 1.5, 1.0), translation=(0.0, 0.12, 0.0), name="back")
    return [
        ("One foot of the chair is pulled down: all four legs grow", "chair_legs", legs, "one foot"),
        ("The top of its back is pulled up", "chair_back", tall, ""),
    ]


def _quadruped(sample: Sample, session: Session) -> list[Edit]:
    vertices = sample.mesh.vertices
    horn, head = sample.vertices_of("horn", 0), sample.vertices_of("head")
    tip, root = _lowest(-vertices, horn), vertices[_lowest(vertices, horn)]
    legs, bent, local, held = (session() for _ in range(4))
    legs.add(_lowest(vertices, sample.vertices_of("hoof", 0)), translation=(0.0, -0.3, 0.0), name="hoof")
    for each, locality in ((bent, 0.0), (local, 6.0), (held, 0.0)):
        each.add(tip, rotation=(-50.0, 0.0, 0.0), scale=1.4, pivot=root, locality=locality, name="horn")
    held.fix(int(head[vertices[head, 2].argmax()]))  # the muzzle
    return [
        ("One hoof is pulled down: all four legs grow", "quadruped_legs", legs, "one hoof"),
        ("One horn is bent: what looks alike follows", "quadruped_horn", bent, ""),
        ("The same with locality 6: it stays near", "quadruped_horn_local", local, ""),
        ("The same with a fixed point on the muzzle: the head holds", "quadruped_horn_fixed", held, "one horn"),
    ]


def _lowest(vertices: Float64, among: Int64) -> int:
    return int(among[vertices[among, 1].argmin()])
