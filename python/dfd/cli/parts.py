"""`dfd parts`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from dfd.cli.arguments import MeshArgument, check_output

__all__ = ["parts"]


def parts(
    mesh: MeshArgument,
    field: Annotated[
        Path | None, typer.Option(metavar="FIELD", help="The shape's field; without it, it is found or made.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="JSON", help="Write the parts, and the part of every vertex."),
    ] = None,
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw them, numbered.")] = None,
    views: Annotated[int, typer.Option(min=1, max=36, help="From how many sides, all around.")] = 2,
    resolution: Annotated[int, typer.Option(min=16, max=8192, help="Pixels along the side of each picture.")] = 768,
) -> None:
    """Cut MESH into its parts: what looks alike, ends at creases, and would move as one."""
    check_output("--output", output, (".json",))
    check_output("--picture", picture, (".png",))

    import numpy as np

    from dfd import Field, distill, load
    from dfd.common.files import atomic_write
    from dfd.common.progress import Stages
    from dfd.segmentation.parts import parts as parts_of

    stages = Stages()
    with stages.stage("read"):
        shape = load(mesh)
    opened = distill(shape, progress=stages) if field is None else Field.load(field, mesh=shape)
    with stages.stage("parts"):
        found = parts_of(opened, shape).cut()
    labels = np.argmax([part.mask for part in found], axis=0)
    rows: list[dict[str, Any]] = [
        {"part": number, "share": round(each.share, 4), "pieces": each.pieces, "vertex": each.vertex}
        for number, each in enumerate(found, start=1)
    ]
    if output is not None:
        with atomic_write(output) as temporary:
            temporary.write_text(json.dumps({"parts": rows, "part_of_vertex": (labels + 1).tolist()}), "utf-8")
    if picture is not None:
        from dfd.pictures.colors import part_colors
        from dfd.pictures.sheet import save_sheet

        how = {
            "colors": part_colors(labels),
            "handles": shape.vertices[[row["vertex"] for row in rows]],
            "labels": [str(row["part"]) for row in rows],
        }
        save_sheet(
            picture,
            shape,
            [(f"{len(rows)} parts", how)],
            views=views,
            azimuth=35.0,
            resolution=resolution,
            file=mesh,
        )
    for row in rows:
        pieces = f"{row['pieces']} pieces" if row["pieces"] > 1 else "1 piece"
        typer.echo(f"{row['part']:3d}  {row['share']:6.1%} of the surface, {pieces}, at vertex {row['vertex']}")
