"""`dfd show`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dfd.cli.arguments import MeshArgument, check_output, place
from dfd.common import check

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["show"]


def show(
    mesh: MeshArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="PNG", help="The picture to write.")],
    field: Annotated[
        Path | None, typer.Option(metavar="FIELD", help="The shape's field: colours what looks alike alike.")
    ] = None,
    handle: Annotated[
        list[str] | None,
        typer.Option(metavar="VERTEX|X,Y,Z", help="Show what would follow a handle here, as heat; repeatable."),
    ] = None,
    fix: Annotated[
        list[str] | None, typer.Option(metavar="VERTEX|X,Y,Z", help="Hold this, and what looks like it; repeatable.")
    ] = None,
    locality: Annotated[
        float, typer.Option(metavar="λ", help="0 reaches all that looks alike, more stays nearer.")
    ] = 0.0,
    views: Annotated[int, typer.Option(min=1, max=36, help="From how many sides, all around.")] = 1,
    azimuth: Annotated[
        float | None,
        typer.Option(
            help="Where the first side is, degrees from the front (+z) to +x; by default where the handle shows."
        ),
    ] = None,
    elevation: Annotated[float, typer.Option(help="From how high up, degrees.")] = 15.0,
    resolution: Annotated[int, typer.Option(min=16, max=8192, help="Pixels along the side of each picture.")] = 768,
) -> None:
    """Draw MESH: by itself, in the colours of its features, or the weights of handles as heat."""
    if field is None and (handle or fix):
        raise ValueError("`--field` must be given: weights come from it")
    if fix and not handle:
        raise ValueError("`--handle` must be given: fixed points hold back what follows one")
    for option, angle in (("--azimuth", azimuth), ("--elevation", elevation)):
        if angle is not None:
            check.number("dfd", option, angle)
    check_output("--output", output, (".png",))

    from dfd import load
    from dfd.common.progress import Stages
    from dfd.pictures.before_after import azimuth_towards
    from dfd.pictures.picture import contact_sheet, picture, save_png

    stages = Stages()
    with stages.stage("read"):
        shape = load(mesh)
    rows = _rows(shape, field, handle or [], fix or [], locality, stages)
    drawn = []
    with stages.stage("draw", len(rows) * views) as advance:
        for title, options in rows:
            first = azimuth_towards(shape, options.get("handles", ())) if azimuth is None else azimuth
            sides = []
            for side in range(views):
                angle = first + 360.0 * side / views
                image = picture(shape, azimuth=angle, elevation=elevation, resolution=resolution, **options)
                sides.append((image, f"{angle % 360:.0f}°"))
                advance()
            drawn.append((title, sides))
    if len(rows) == 1 and views == 1:
        save_png(output, drawn[0][1][0][0])
    else:
        save_png(output, contact_sheet(drawn, cell=resolution))
    typer.echo(f"{output}: {'; '.join(title for title, _ in rows)}", err=True)


def _rows(
    shape: Mesh, field: Path | None, handles: list[str], fix: list[str], locality: float, stages: Any
) -> list[tuple[str, dict[str, Any]]]:
    """What each row of pictures is called, and what `picture` is to draw in it."""
    if field is None:
        return [("the mesh", {})]

    from dfd import CompactFeatures, Deformer, Field
    from dfd.pictures.colors import feature_colors

    deformer = Deformer(shape, Field.load(field, mesh=shape))
    for text in handles:
        deformer.add(place(shape, "--handle", text), locality=locality)
    for text in fix:
        deformer.fix(place(shape, "--fix", text))
    with stages.stage("features", len(shape.vertices)) as advance:
        deformer.prepare(advance)
    if not handles:
        features = deformer.features
        shown = features.principal(3) if isinstance(features, CompactFeatures) else features
        return [("features", {"colors": feature_colors(shown)})]
    with stages.stage("bind"):
        weights = deformer.weights
    fixed = [point.position for point in deformer.fixed] or None
    return [
        (
            f"handle {handle.place}",
            {"weights": weights[:, column], "handles": [handle.place.position], "fixed": fixed},
        )
        for column, handle in enumerate(deformer.handles)
    ]
