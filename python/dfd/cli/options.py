"""Options that several commands share, and functions that make options from tables, such as `CONTROLS`."""

from collections.abc import Callable, Mapping
from copy import copy
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, get_args

from typer import Argument, CallbackParam, Option

from dfd.common.described import About
from dfd.common.preset import Preset as PresetName
from dfd.editing.presets import PRESETS
from dfd.encoders.known import DEFAULT_ENCODER

# The help shows this text for the place of a handle.
PLACE = "VERTEX|X,Y,Z|top|part:NAME|group:NAME|part@X,Y,Z|component@X,Y,Z|…"


def _check_file(parameter: CallbackParam, given: Any) -> Any:
    """Return `given`, a path or a list of paths. Raise FileNotFoundError with the option's name if one is no file."""
    name = parameter.opts[0] if parameter.opts[0].startswith("-") else parameter.metavar
    for path in given if isinstance(given, list | tuple) else [given]:
        if path is not None and (not Path(path).exists() or Path(path).is_dir()):
            raise FileNotFoundError(f"`{name}`: {path} does not exist or is no file")
    return given


READ: Any = {"callback": _check_file}  # settings of an option or an argument whose file is read

Mesh = Annotated[Path, Argument(metavar="MESH", help="OBJ, PLY, STL, OFF, GLB or glTF file.")]
MadeField = Annotated[
    Path | None, Option(metavar="FIELD", help="The shape's field; by default from the cache, else distilled.", **READ)
]
Force = Annotated[bool, Option("--force", help="Accept a field or an edit of another shape.")]
ForceReplacing = Annotated[
    bool, Option("--force", help="Accept a field or an edit of another shape, and an --output that replaces MESH.")
]
PRESET = "Defaults of all other settings: dfd's or the paper's. If left out, "
Preset = Annotated[PresetName | None, Option(metavar="default|paper", help=f"{PRESET}dfd's.")]
PresetOfEdit = Annotated[
    PresetName | None, Option(metavar="default|paper", help=f"{PRESET}the preset of --edit, else dfd's.")
]
Fix = Annotated[
    list[str] | None,
    Option(metavar="PLACE[:S]", help="Fix this place and surface like it, with a strength S from 0 to 1; repeatable."),
]


def _checked_encoder(name: str) -> str:
    """Return `name`. Raise ValueError if no encoder can have this name, before anything else is read."""
    if name != DEFAULT_ENCODER:
        from dfd.encoders.sources import check_encoder

        check_encoder(name)
    return name


Encoder = Annotated[
    str,
    Option(
        metavar="NAME",
        help="The encoder: a known name, a weights folder, or a name on the Hugging Face hub.",
        callback=_checked_encoder,
    ),
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


def group_options(command: Callable[..., None], panels: Mapping[str, tuple[str, ...]]) -> None:
    """Show options of `command` under headings in the help: `panels` has the names of the options of each heading."""
    heading = {name: panel for panel, names in panels.items() for name in names}
    own = [
        each.replace(annotation=_under(each.annotation, heading[each.name])) if each.name in heading else each
        for each in signature(command, eval_str=True).parameters.values()
    ]
    command.__signature__ = signature(command).replace(parameters=own)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in own}


def _under(annotation: Any, panel: str) -> Any:
    """Return the annotation of an option with the heading `panel`. Other commands keep the option without it."""
    kind, option = get_args(annotation)
    option = copy(option)
    option.rich_help_panel = panel
    return Annotated[kind, option]


def from_table(table: Mapping[str, About], *, panel: str | None = None) -> dict[str, Any]:
    """Return an option's annotation for each entry of `table`. The help shows the default of each preset.

    `panel` is the heading above these options in the help.
    """
    return {name: _row(name, about, panel) for name, about in table.items()}


def _row(name: str, about: About, panel: str | None) -> Any:
    flag = "--" + (about.option or name).replace("_", "-")
    kind: Any = str
    if about.metavar is None:
        kind, flag = bool, f"{flag}/--no-{flag[2:]}"
    elif about.repeated:
        kind, flag = list[str], flag[:-1]
    own = name in PRESETS["default"].handle
    said = by_preset(*(getattr(PRESETS[preset], name) for preset in ("default", "paper"))) if own else False
    how: dict[str, Any] = {"metavar": about.metavar, "help": about.text, "show_default": said}
    return Annotated[kind | None, Option(flag, rich_help_panel=panel, **how)]


def by_preset(default: Any, *paper: Any) -> str:
    """Return an option's default for the help, such as "0.5; paper: 0", from the values of the presets."""
    return "; paper: ".join(map(_shown, dict.fromkeys((default, *paper))))


def _shown(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)
