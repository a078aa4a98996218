"""`dfd show`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from dfd.cli.arguments import (
    PLACE,
    FixOption,
    ForceOption,
    MeshArgument,
    Places,
    PresetOption,
    ResolutionOption,
    ViewsOption,
    check_camera,
    check_output,
    chosen_preset,
    controls,
    with_controls,
)
from dfd.cli.errors import say

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dfd.mesh.mesh import Mesh


@with_controls("reach_targets", "bridges")
def show(
    context: typer.Context,
    mesh: MeshArgument,
    output: Annotated[Path, Option("--output", "-o", metavar="PNG", help="The picture to write.")],
    field: Annotated[Path | None, Option(metavar="FIELD", help="Its field: colors what looks alike alike.")] = None,
    handle: Annotated[
        list[str] | None,
        Option(metavar=PLACE, help="Show what follows a handle here, as heat; without --field, mark it; repeatable."),
    ] = None,
    preset: PresetOption = None,
    fix: FixOption = None,
    views: ViewsOption = 1,
    azimuth: Annotated[
        float | None,
        Option(help="Where the first side is, degrees from the front (+z) to +x; by default where the handle shows."),
    ] = None,
    elevation: Annotated[float, Option(help="From how high up, degrees.")] = 15.0,
    zoom: Annotated[float, Option(help="Above 1 nearer, at the handle.")] = 1.0,
    axes: Annotated[bool, Option("--axes", help="Draw the directions of the axes.")] = False,
    numbers: Annotated[bool, Option("--numbers", help="Write the indices of vertices that are seen.")] = False,
    legend: Annotated[bool, Option("--legend", help="Draw the scale of the heat beside it.")] = False,
    resolution: ResolutionOption = 768,
    force: ForceOption = False,
    **described: Any,
) -> None:
    """Draw MESH: by itself, in the colors of its features, or the weights of handles as heat."""
    given = controls(context.params)
    heat = field is not None and bool(handle)
    if field is None and (given or fix):
        raise ValueError("`--field` must be given: weights come from it")
    if (given or fix) and not handle:
        raise ValueError("`--handle` must be given: the others say what follows one, and what is held back")
    if legend and not heat:
        raise ValueError("`--legend` needs `--field` and `--handle`: it is the scale of their heat")
    check_camera(azimuth, elevation, zoom)
    check_output("--output", output, (".png",))

    from dfd import load
    from dfd.common.progress import Stages
    from dfd.pictures.sheet import save_sheet

    stages = Stages()
    with stages.stage("read"):
        shape = load(mesh)
    places = Places(shape)
    if field is None:
        marked = [places.find("--handle", text).position for text in handle or ()]
        rows: list[tuple[str, dict[str, Any]]] = [("the mesh", {"handles": marked} if marked else {})]
    else:
        whole = {"preset": chosen_preset(preset)} | {key: described[key] for key in ("reach_targets", "bridges")}
        rows = _rows(shape, field, handle or [], given, fix or [], whole, places, stages, force)
    if heat and not legend and len(rows) * views > 1:
        legend = True
    with stages.stage("draw", len(rows) * views) as advance:
        save_sheet(
            output,
            shape,
            rows,
            views=views,
            azimuth=azimuth,
            legend=legend,
            file=mesh,
            advance=advance,
            elevation=elevation,
            zoom=zoom,
            axes=axes,
            numbers=numbers,
            resolution=resolution,
        )
    places.tell()
    say(f"{output}: {'; '.join(title for title, _ in rows)}")


def _rows(
    shape: Mesh,
    field: Path,
    handles: list[str],
    given: dict[str, Any],
    fix: list[str],
    whole: dict[str, Any],
    places: Places,
    stages: Any,
    force: bool,
) -> list[tuple[str, dict[str, Any]]]:
    """What each row of pictures is called, and what `picture` is to draw in it."""
    from dfd import CompactFeatures, Deformer, Field
    from dfd.pictures.colors import feature_colors

    deformer = Deformer(shape, Field.load(field, mesh=shape, other_shape=force), other_shape=force)
    deformer.set(**whole)
    places.session = deformer
    for text in handles:
        deformer.add(places.find("--handle", text), **given)
    for text in fix:
        at, strength = places.fixed("--fix", text)
        deformer.fix(at, strength=strength)
    with stages.stage("features", len(shape.vertices)) as advance:
        deformer.prepare(advance)
    if not handles:
        features = deformer.features
        shown = features.principal(3) if isinstance(features, CompactFeatures) else features
        return [("features", {"colors": feature_colors(shown)})]
    with stages.stage("bind"):
        weights: NDArray[Any] = deformer.following
    fixed = [point.position for point in deformer.fixed] or None
    return [
        (f"handle {handle.place}", {"weights": weights[:, column], "handles": [handle.place.position], "fixed": fixed})
        for column, handle in enumerate(deformer.handles)
    ]


def pick(
    picture: Annotated[Path, Argument(metavar="PNG", help="A picture that `dfd show` or `dfd deform --picture` drew.")],
    x: Annotated[float, Argument(metavar="X", help="Pixels from its left edge.")],
    y: Annotated[float, Argument(metavar="Y", help="Pixels from its upper edge.")],
    mesh: Annotated[Path | None, Argument(metavar="[MESH]", help="What it shows, where that was renamed.")] = None,
    as_json: Annotated[bool, Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """Say which vertex lies under a pixel of a picture, for --handle and --fix."""
    from dfd import load
    from dfd.pictures.pick import pick as pick_vertex

    found = pick_vertex(picture, x, y, None if mesh is None else load(mesh))
    if as_json:
        say(json.dumps(asdict(found)), result=True)
        return
    position = ",".join(f"{value:.6g}" for value in found.position)
    say(f"vertex {found.vertex} at {position}, {found.distance:.3g} from what the pixel shows", result=True)
