"""The command `dfd demo`: distill and edit two sample shapes, and draw them in one picture."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from dfd.cli import options
from dfd.cli.errors import say
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.common.linear_algebra import UInt8
    from dfd.editing.deformer import Deformer

    Picture = tuple[UInt8, str]

ASIDE, BEHIND = 35.0, 215.0  # camera azimuths, degrees: front view turned 35° to the side, and the opposite view
FACES = 20_000  # number of faces of each sample
FOOT = {"at": "bottom", "translation": (0.0, -0.35, 0.0), "name": "foot"}
HOOF = {"at": "bottom", "translation": (0.0, -0.3, 0.0), "name": "hoof"}
HORN = {"at": "top", "rotation": (-50.0, 0.0, 0.0), "scale": 1.4, "level": -1, "name": "horn"}
BACK = {"at": "top", "scale": (1.0, 1.5, 1.0), "translation": (0.0, 0.12, 0.0), "name": "back"}
# For each sample, its edits: the title of a row of pictures, the name of the written files, and the handle.
EDITS: dict[str, tuple[tuple[str, str, dict[str, Any]], ...]] = {
    "chair": (
        ("One foot of the chair is pulled down: all four legs grow", "chair_legs", FOOT),
        ("The top of the back is pulled up", "chair_back", BACK),
    ),
    "quadruped": (
        ("One hoof is pulled down: all four legs grow", "quadruped_legs", HOOF),
        ("One horn is rotated: all similar surface follows", "quadruped_horn", HORN),
        ("The same horn with locality 6: only near surface follows", "quadruped_horn_local", {**HORN, "locality": 6.0}),
    ),
}


def demo(
    output: Annotated[Path, Option("--output", "-o", help="Folder for meshes and pictures.")] = Path("demo"),
    preset: options.Preset = None,
) -> None:
    """Distill and deform two sample shapes, and draw the results."""
    from dfd import samples
    from dfd.common.progress import Stages
    from dfd.distillation.distill import distill
    from dfd.distillation.settings import DistillSettings
    from dfd.editing.deformer import Deformer
    from dfd.encoders.encode import load_encoder
    from dfd.pictures.colors import feature_colors
    from dfd.pictures.contact_sheet import contact_sheet
    from dfd.pictures.picture import picture, save_png
    from dfd.symmetry.plane import axis_name
    from dfd.symmetry.search import symmetry_planes
    from dfd.views.render import render

    chosen = preset or "default"
    if output.exists() and not output.is_dir():
        raise ValueError(f"`--output` must be a folder, got the file {output}")
    output.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[str, list[Picture]]] = []
    encoder = load_encoder(DEFAULT_ENCODER, **DistillSettings(preset=chosen).of_encoder())
    for name, edits in EDITS.items():
        mesh, stages = getattr(samples, name)(FACES).mesh, Stages()
        say(f"{name}: {len(mesh.faces):,} faces", result=True)
        field = distill(mesh, encoder, progress=stages, cache=False, preset=chosen)
        field.save(output / f"{name}.field.safetensors")
        mesh.save(output / f"{name}.glb")
        with stages.stage("symmetry"):
            planes = symmetry_planes(mesh, field)
        mirrors = ", ".join(f"{axis_name(plane.normal)} ({plane.score:.2f})" for plane in planes) or "none"
        images, features = render(mesh, views=24, resolution=320).images, field.features(mesh)
        draw = partial(picture, mesh, colors=feature_colors(features))
        seen = [(images[index], f"view {index + 1} of 24") for index in (6, 9, 16)]
        seen += [(draw(azimuth=ASIDE), "features")]
        seen += [(draw(azimuth=BEHIND), f"features, behind; mirror plane found: {mirrors}")]
        rows.append((f"The {name}: what the encoder sees, and the features as colors", seen))
        with stages.stage("draw"):
            for title, file, handle in edits:
                deformer = Deformer(mesh, field, preset=chosen, features=features)
                deformer.add(**handle)
                mesh.save(output / f"{file}.glb", deformer.vertices)
                deformer.save(output / f"{file}.json")
                rows.append((title, _drawn(deformer)))
        say(f"{name}: {stages}", result=True)
    save_png(output / "story.png", contact_sheet(rows, title="Deep feature deformation: all similar parts move"))
    say(f"Picture: {output / 'story.png'}\nMeshes, fields and edits: {output}", result=True)


def _drawn(deformer: Deformer) -> list[Picture]:
    """Draw the weights and the deformed shape from `ASIDE` and `BEHIND`, and the resting shape from `ASIDE`."""
    from dfd.pictures.contact_sheet import heat_bar
    from dfd.pictures.picture import picture
    from dfd.pictures.sheet import session_views

    views, cells = session_views(deformer, ASIDE), []
    sides = ("weights", ASIDE), ("weights", BEHIND), ("before", ASIDE), ("after", ASIDE), ("after", BEHIND)
    for name, azimuth in sides:
        drawn = picture(deformer.mesh, **{**views[name], "azimuth": azimuth})
        cells.append((drawn, name if azimuth == ASIDE else f"{name}, behind"))
    cells.insert(2, (heat_bar(512), ""))
    return cells
