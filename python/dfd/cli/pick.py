"""`dfd pick`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["pick"]


def pick(
    picture: Annotated[
        Path, typer.Argument(metavar="PNG", help="A picture that `dfd show` or `dfd deform --picture` drew.")
    ],
    x: Annotated[float, typer.Argument(metavar="X", help="Pixels from its left edge.")],
    y: Annotated[float, typer.Argument(metavar="Y", help="Pixels from its upper edge.")],
    mesh: Annotated[
        Path | None, typer.Argument(metavar="[MESH]", help="What it shows, where that has another name by now.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """Say which vertex lies under a pixel of a picture, for --handle and --fix."""
    from dfd import load
    from dfd.pictures.pick import pick as pick_vertex

    found = pick_vertex(picture, x, y, None if mesh is None else load(mesh))
    if as_json:
        typer.echo(json.dumps(asdict(found)))
        return
    position = ",".join(f"{value:.6g}" for value in found.position)
    typer.echo(f"vertex {found.vertex} at {position}, {found.distance:.3g} from what the pixel shows")
