"""What is said of a handle and of the whole shape on the command line, spelled once for all commands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from dfd.common import check
from dfd.common.preset import Preset
from dfd.editing.presets import PRESETS

__all__ = [
    "CONTROLS",
    "ArriveOption",
    "BridgesOption",
    "FalloffOption",
    "FixOption",
    "InstancesOption",
    "LevelOption",
    "LocalityOption",
    "MirroredLocalityOption",
    "PresetOption",
    "RadiusOption",
    "ReachOption",
    "StrengthOption",
    "WithinOption",
    "WithinWidthOption",
    "WithoutInstancesOption",
    "chosen_preset",
    "controls",
    "number_or",
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

_NEW, _PAPER = PRESETS["default"], PRESETS["paper"]

PresetOption = Annotated[
    str | None,
    typer.Option(
        metavar="default|paper",
        help="What nothing else says: dfd's own, or the paper's equations to the letter; by default as --edit has it.",
    ),
]
ReachOption = Annotated[
    str | None,
    typer.Option(
        metavar="R|auto",
        help=f"How unlike it what follows may be: {_NEW.reach:g} unless given, the paper's is {_PAPER.reach:g}.",
    ),
]
FalloffOption = Annotated[
    str | None,
    typer.Option(
        metavar="CURVE",
        help=f"From it to that end: {_NEW.falloff} unless given, {_PAPER.falloff} (the paper's), sharp, root, sphere"
        " or constant.",
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
BridgesOption = Annotated[
    bool | None,
    typer.Option("--bridges/--no-bridges", help="Whether --locality and --radius reach across small gaps."),
]
MirroredLocalityOption = Annotated[
    bool | None,
    typer.Option(
        "--mirrored-locality/--no-mirrored-locality",
        help="Whether they are measured from the handle's mirror image as well, with --symmetry.",
    ),
]


def controls(values: Mapping[str, Any]) -> dict[str, Any]:
    """What of `values`, a command's parameters, `Deformer.add` takes as controls; what was not given is left out.

    Raises
    ------
    ValueError
        If `--reach` is neither auto nor a number.
    """
    given = {name: values[name] for name in CONTROLS if values[name] not in (None, [], ())}
    if "reach" in given and given["reach"] != "part":
        given["reach"] = number_or("auto", "--reach", given["reach"], "part, or a number above 0")
    return given


def chosen_preset(preset: str | None) -> Preset | None:
    """The preset of that name, or None where none was named.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    return None if preset is None else check.choice("dfd", "--preset", preset, Preset)


def number_or(word: str, option: str, text: str, number: str) -> Any:
    """The number that `text` is, or `word`; `number` describes what is wanted.

    Raises
    ------
    ValueError
        In the name of `option`, if it is neither.
    """
    if text == word:
        return word
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"`{option}` must be {word} or {number}, got {text!r}") from None
