"""Options that several commands share, and functions that make options from tables, such as `CONTROLS`."""

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from dfd.common.described import About
from dfd.common.preset import Preset as PresetName
from dfd.editing.presets import PRESETS

# The help shows this text for the place of a handle.
PLACE = "VERTEX|X,Y,Z|top|part:NAME|group:NAME|part@X,Y,Z|component@X,Y,Z|…"

Mesh = Annotated[Path, Argument(metavar="MESH", help="OBJ, PLY, STL, OFF, GLB or glTF file.")]
Field = Annotated[Path, Option(metavar="FIELD", help="The shape's field, as `dfd distill` wrote it.")]
MadeField = Annotated[
    Path | None, Option(metavar="FIELD", help="The shape's field; by default from the cache, else distilled.")
]
Force = Annotated[bool, Option("--force", help="Accept a field or an edit of another shape.")]
Preset = Annotated[
    PresetName | None,
    Option(
        metavar="default|paper",
        help="Defaults of all other settings: dfd's or the paper's. If left out, the preset of --edit, else dfd's.",
    ),
]
Fix = Annotated[
    list[str] | None,
    Option(metavar="PLACE[:S]", help="Fix this place and surface like it, with a strength S from 0 to 1; repeatable."),
]
Encoder = Annotated[
    str, Option(metavar="NAME", help="The encoder: a known name, a weights folder, or a name on the Hugging Face hub.")
]
Threshold = Annotated[
    float | None, Option(min=0.0, max=1.0, help="Smallest confidence of a transferred edit; 0.5 if left out.")
]
Azimuth = Annotated[
    float | None,
    Option(help="Azimuth of the first view, in degrees from +z to +x; by default, the camera faces the handles."),
]
Elevation = Annotated[float, Option(min=-90.0, max=90.0, help="Elevation of the camera, degrees.")]
Zoom = Annotated[float, Option(min=0.01, help="Magnification; above 1, the handles are at the center.")]
Views = Annotated[int, Option(min=1, max=36, help="Number of views around the shape.")]
Resolution = Annotated[int, Option(min=16, max=8192, help="Width and height of each picture, pixels.")]


def add_options(command: Callable[..., None], annotations: Mapping[str, Any], after: str) -> None:
    """Replace the `**` keywords of `command` by options with these `annotations`, after the parameter `after`."""
    own = [each for each in signature(command, eval_str=True).parameters.values() if each.kind is not each.VAR_KEYWORD]
    index = 1 + [each.name for each in own].index(after)
    own[index:index] = [
        Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=annotation)
        for name, annotation in annotations.items()
    ]
    command.__signature__ = signature(command).replace(parameters=own)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in own}


def from_table(table: Mapping[str, About]) -> dict[str, Any]:
    """Return an option's annotation for each entry of `table`. The help shows the default of each preset."""
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
    """Return an option's default for the help, such as "0.5; paper: 0", from the values of the presets."""
    return "; paper: ".join(map(_shown, dict.fromkeys((default, *paper))))


def _shown(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)
