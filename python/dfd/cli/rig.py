"""`dfd rig`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfd.cli.arguments import FieldOption, check_output

__all__ = ["rig"]


def rig(
    character: Annotated[Path, typer.Argument(metavar="CHARACTER", help="GLB or glTF file with a skin.")],
    field: FieldOption,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="GLB", help="The file to write.")],
    influences: Annotated[int, typer.Option(min=1, help="How many joints a vertex follows at most.")] = 4,
) -> None:
    """Weigh the vertices of CHARACTER anew by its bones: what looks alike and is near follows."""
    check_output("--output", output, (".glb", ".gltf"))

    from dfd import Field, load, weigh_skin
    from dfd.common.progress import Stages

    stages = Stages()
    with stages.stage("read"):
        shape = load(character)
        opened = Field.load(field, mesh=shape)
    with stages.stage("weigh"):
        report = weigh_skin(shape, opened, output, influences=influences)
    typer.echo(f"{output}: {report}", err=True)
