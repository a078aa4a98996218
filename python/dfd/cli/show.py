"""The command `dfd show`: draw a mesh, its features, or the weights of handles."""

from pathlib import Path
from typing import Annotated, Any

from typer import Option

from dfd.cli import options
from dfd.cli.arguments import check_output, hold, open_field, open_mesh
from dfd.cli.errors import say
from dfd.cli.handles import value_of
from dfd.cli.rehearsal import check_edit
from dfd.editing.controls import CONTROLS
from dfd.encoders.known import DEFAULT_ENCODER


def show(
    mesh: options.Mesh,
    output: Annotated[Path, Option("--output", "-o", metavar="PNG", help="The picture to write.")],
    field: Annotated[
        Path | None,
        Option(
            metavar="FIELD",
            help="The shape's field; for weights, by default from the cache, else distilled. Without --handle, similar"
            " features get similar colors.",
        ),
    ] = None,
    encoder: options.Encoder = DEFAULT_ENCODER,
    preset: options.Preset = None,
    handle: Annotated[
        list[str] | None, Option(metavar=options.PLACE, help="Show the weights of a handle at this place; repeatable.")
    ] = None,
    fix: options.Fix = None,
    views: options.Views = 1,
    azimuth: options.Azimuth = None,
    elevation: options.Elevation = 15.0,
    zoom: options.Zoom = 1.0,
    axes: Annotated[bool, Option("--axes", help="Draw the directions of the axes.")] = False,
    legend: Annotated[bool, Option("--legend", help="Draw the color scale of the weights.")] = False,
    resolution: options.Resolution = 768,
    force: options.Force = False,
    **controls: Any,
) -> None:
    """Draw MESH alone, in the colors of its features, or with the weights of handles as a heat map."""
    given = {name: value_of(value) for name, value in controls.items() if value not in (None, [])}
    if (given or fix) and not handle:
        raise ValueError("`--handle` must be given with `--fix` and the controls of a handle")
    if legend and not handle:
        raise ValueError("`--legend` needs `--handle`: it is the color scale of the weights")
    check_output("--output", output, (".png",))

    from dfd import Deformer
    from dfd.common.progress import Stages
    from dfd.pictures.colors import feature_colors
    from dfd.pictures.sheet import save_sheet

    stages = Stages()
    shape = open_mesh(mesh, stages)
    rows: list[tuple[str, dict[str, Any]]] = []  # the title of each row of pictures, and the arguments of `picture`
    if field is None and not handle:
        rows = [("the mesh", {})]
    else:
        held = [(text, given) for text in handle or ()]
        check_edit(shape, held, fix, preset=preset)
        opened = open_field(shape, field, force=force, encoder=encoder, preset=preset, progress=stages)
        deformer = Deformer(shape, opened, preset=preset or "default", other_shape=force)
        hold(deformer, held, fix)
        with stages.stage("features", len(shape.vertices)) as advance:
            deformer.prepare(advance)
        if handle:
            with stages.stage("bind"):
                weights = deformer.following
            fixed = [point.place.position for point in deformer.fixed] or None
            for text, each, column in zip(handle, deformer.handles, weights.T, strict=True):
                marks = {"weights": column, "handles": [each.place.position], "fixed": fixed}
                rows.append((f"handle {text}", marks))
            legend = legend or len(rows) * views > 1
        else:
            rows = [("features", {"colors": feature_colors(deformer.features)})]
    look: dict[str, Any] = {"azimuth": azimuth, "elevation": elevation, "zoom": zoom, "axes": axes}
    with stages.stage("draw", len(rows) * views) as advance:
        save_sheet(output, shape, rows, views=views, legend=legend, advance=advance, resolution=resolution, **look)
    say(f"{output}: {'; '.join(title for title, _ in rows)}")


options.add_options(show, options.from_table(CONTROLS), after="handle")
