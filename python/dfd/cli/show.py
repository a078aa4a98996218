"""`dfd show`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from dfd.cli.arguments import (
    PLACE,
    AzimuthOption,
    ElevationOption,
    FixOption,
    ForceOption,
    MeshArgument,
    Places,
    PresetOption,
    ResolutionOption,
    ViewsOption,
    ZoomOption,
    check_output,
    chosen_preset,
    open_shape,
)
from dfd.cli.errors import say
from dfd.cli.handles import controls, with_controls


@with_controls
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
    azimuth: AzimuthOption = None,
    elevation: ElevationOption = 15.0,
    zoom: ZoomOption = 1.0,
    axes: Annotated[bool, Option("--axes", help="Draw the directions of the axes.")] = False,
    legend: Annotated[bool, Option("--legend", help="Draw the scale of the heat beside it.")] = False,
    resolution: ResolutionOption = 768,
    force: ForceOption = False,
    **described: Any,
) -> None:
    """Draw MESH: by itself, in the colors of its features, or the weights of handles as heat."""
    given = controls(context.params)
    if field is None and (given or fix):
        raise ValueError("`--field` must be given: weights come from it")
    if (given or fix) and not handle:
        raise ValueError("`--handle` must be given: the others say what follows one, and what is held back")
    if legend and (field is None or not handle):
        raise ValueError("`--legend` needs `--field` and `--handle`: it is the scale of their heat")
    check_output("--output", output, (".png",))

    from dfd import Deformer
    from dfd.common.progress import Stages
    from dfd.pictures.colors import feature_colors
    from dfd.pictures.sheet import save_sheet

    stages = Stages()
    shape, opened = open_shape(mesh, field, stages, force=force)
    rows: list[tuple[str, dict[str, Any]]] = []  # the title of each row of pictures, and the arguments of `picture`
    if opened is None:
        places = Places(shape)
        marked = [places.find("--handle", text).position for text in handle or ()]
        rows = [("the mesh", {"handles": marked} if marked else {})]
    else:
        deformer = Deformer(shape, opened, preset=chosen_preset(preset) or "default", other_shape=force)
        places = Places(shape, deformer)
        for text in handle or ():
            deformer.add(places.find("--handle", text), **given)
        for text in fix or ():
            at, strength = places.fixed("--fix", text)
            deformer.fix(at, strength=strength)
        with stages.stage("features", len(shape.vertices)) as advance:
            deformer.prepare(advance)
        if handle:
            with stages.stage("bind"):
                weights = deformer.following
            fixed = [point.position for point in deformer.fixed] or None
            for column, each in enumerate(deformer.handles):
                marks = {"weights": weights[:, column], "handles": [each.place.position], "fixed": fixed}
                rows.append((f"handle {each.place}", marks))
            legend = legend or len(rows) * views > 1
        else:
            rows = [("features", {"colors": feature_colors(deformer.features)})]
    with stages.stage("draw", len(rows) * views) as advance:
        save_sheet(
            output,
            shape,
            rows,
            views=views,
            azimuth=azimuth,
            legend=legend,
            advance=advance,
            elevation=elevation,
            zoom=zoom,
            axes=axes,
            resolution=resolution,
        )
    places.tell()
    say(f"{output}: {'; '.join(title for title, _ in rows)}")
