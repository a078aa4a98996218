"""Options of several commands, and those that the tables of controls, motions and settings describe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from dfd.common.described import About
from dfd.common.preset import Preset as PresetName
from dfd.editing.presets import PRESETS

# What a handle or a fixed point may be.
PLACE = "VERTEX|X,Y,Z|top|part:NAME|group:NAME|part@X,Y,Z|component@X,Y,Z|…"

Mesh = Annotated[Path, Argument(metavar="MESH", help="OBJ, PLY, STL, OFF, GLB or glTF file.")]
Field = Annotated[Path, Option(metavar="FIELD", help="The shape's field, as `dfd distill` wrote it.")]
MadeField = Annotated[Path | None, Option(metavar="FIELD", help="The shape's field; without it, it is found or made.")]
Force = Annotated[bool, Option("--force", help="Take a field or an edit of another shape all the same.")]
Preset = Annotated[
    PresetName | None,
    Option(
        metavar="default|paper",
        help="Defaults of what is left out: dfd's own, or the paper's equations; if not given, those of --edit.",
    ),
]
Fix = Annotated[
    list[str] | None,
    Option(metavar="PLACE[:S]", help="Hold this, and what looks like it, by a strength S from 0 to 1; repeatable."),
]
Encoder = Annotated[
    str, Option(metavar="NAME", help="What makes fields: a known name, a folder with weights, or a hub name.")
]
Threshold = Annotated[
    float | None, Option(min=0.0, max=1.0, help="Least confidence with which an edit is carried; 0.5 if left out.")
]
Azimuth = Annotated[
    float | None, Option(help="The first side, degrees from the front (+z) to +x; by default where the handles show.")
]
Elevation = Annotated[float, Option(min=-90.0, max=90.0, help="Degrees above the horizon.")]
Zoom = Annotated[float, Option(min=0.01, help="Above 1 is nearer, towards the handles.")]
Views = Annotated[int, Option(min=1, max=36, help="How many sides are drawn, all around.")]
Resolution = Annotated[int, Option(min=16, max=8192, help="Pixels along the side of each picture.")]


def add_options(command: Callable[..., None], annotations: Mapping[str, Any], after: str) -> None:
    """Let `command`, which takes `**` keywords, have these options behind its parameter `after`; None is not given."""
    own = [each for each in signature(command, eval_str=True).parameters.values() if each.kind is not each.VAR_KEYWORD]
    index = 1 + [each.name for each in own].index(after)
    own[index:index] = [
        Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation)
        for name, annotation in annotations.items()
    ]
    command.__signature__ = signature(command).replace(parameters=own)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in own}


def from_table(table: Mapping[str, About]) -> dict[str, Any]:
    """Return the annotation of an option for each row of a table, with the value of each preset."""
    return {name: _row(name, about) for name, about in table.items()}


def _row(name: str, about: About) -> Any:
    flag = "--" + (about.option or name).replace("_", "-")
    kind: Any = str
    if about.metavar is None:
        kind, flag = bool, f"{flag}/--no-{flag[2:]}"
    elif about.repeated:
        kind, flag = list[str], flag[:-1]
    own = name in PRESETS["default"].handle
    said = by_preset(*(getattr(PRESETS[preset], name) for preset in ("default", "paper"))) if own else False
    return Annotated[kind | None, Option(flag, metavar=about.metavar, help=about.text, show_default=said)]


def by_preset(default: Any, *paper: Any) -> str:
    """Return what the help says of an option that has these values in the presets unless it is given."""
    return "; paper: ".join(map(_shown, dict.fromkeys((default, *paper))))


def _shown(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)
