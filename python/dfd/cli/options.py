"""What is said of a handle and of the whole shape on the command line, spelled once for all commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer

__all__ = [
    "CONTROLS",
    "ArriveOption",
    "FalloffOption",
    "FixOption",
    "InstancesOption",
    "LevelOption",
    "LocalityOption",
    "RadiusOption",
    "ReachOption",
    "StrengthOption",
    "WithinOption",
    "WithinWidthOption",
    "WithoutInstancesOption",
    "controls",
]

# The parameters that shape the weights of one handle, named as `Deformer.add` names them.
CONTROLS = (
    "reach",
    "falloff",
    "locality",
    "radius",
    "strength",
    "instances",
    "level",
    "without_instances",
    "within",
    "within_width",
)

ReachOption = Annotated[
    str | None,
    typer.Option(metavar="R|auto", help="How unlike it what follows may be: 0.7 unless given, 1 is the paper's."),
]
FalloffOption = Annotated[
    str | None,
    typer.Option(
        metavar="CURVE",
        help="From it to that end: smooth unless given, linear (the paper's), sharp, root, sphere or constant.",
    ),
]
LocalityOption = Annotated[
    float | None, typer.Option(metavar="λ", help="0 reaches all that looks alike, more stays nearer.")
]
RadiusOption = Annotated[
    str | None,
    typer.Option(metavar="R|P%", help="In place of --locality: how far along the surface, mesh units or % of the box."),
]
StrengthOption = Annotated[float | None, typer.Option(metavar="S", help="From 0 to 1: a factor for what follows.")]
InstancesOption = Annotated[
    str | None,
    typer.Option(
        metavar="own|together|only", help="What looks alike moves about its own pivot, about one, or not at all."
    ),
]
LevelOption = Annotated[
    bool | None, typer.Option("--level/--no-level", help="Let all instances follow fully, however alike.")
]
WithoutInstancesOption = Annotated[
    list[str] | None,
    typer.Option("--without-instance", metavar="PLACE", help="The look-alike there does not move along; repeatable."),
]
WithinOption = Annotated[
    str | None,
    typer.Option(
        metavar="REGION", help="Nothing follows beyond: part:NAME, group:NAME, 'x>0', ball:x,y,z,r or box:x,y,z,x,y,z."
    ),
]
WithinWidthOption = Annotated[
    str | None,
    typer.Option(metavar="W|P%", help="How far beyond --within the weight fades, mesh units or % of the box."),
]
FixOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PLACE[:S]", help="Hold this, and what looks like it, by a strength S from 0 to 1; repeatable."
    ),
]
ArriveOption = Annotated[
    bool | None,
    typer.Option("--arrive/--no-arrive", help="Whether handles reach their target although fixed points hold back."),
]


def controls(values: Mapping[str, Any]) -> dict[str, Any]:
    """What of `values`, a command's parameters, `Deformer.add` takes as controls; what was not given is left out.

    Raises
    ------
    ValueError
        If `--reach` is neither auto nor a number.
    """
    given = {name: values[name] for name in CONTROLS if values[name] not in (None, [], ())}
    reach = given.get("reach", "auto")
    if reach != "auto":
        try:
            given["reach"] = float(reach)
        except ValueError:
            raise ValueError(f"`--reach` must be auto or a number above 0, got {reach!r}") from None
    return given
