"""What several commands take: the mesh, the field, points on the shape, its controls, and files to write."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from dfd.cli.errors import say
from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.common.progress import Stages
    from dfd.editing.deformer import Deformer
    from dfd.editing.points import Place
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

Command = Callable[..., None]

# What a handle or a fixed point may be, in the help of every command.
PLACE = "VERTEX|X,Y,Z|top|part:NAME|group:NAME|part@X,Y,Z|component@X,Y,Z|…"

MeshArgument = Annotated[Path, Argument(metavar="MESH", help="OBJ, PLY, STL, OFF, GLB or glTF file.")]
FieldOption = Annotated[
    Path,
    Option(
        "--field",
        metavar="FIELD",
        help="The shape's field, as `dfd distill` wrote it, or an .npy or .pt with another network's rows of vertices.",
    ),
]
ForceOption = Annotated[bool, Option("--force", help="Take a field or an edit of another shape all the same.")]
PresetOption = Annotated[
    str | None,
    Option(
        metavar="default|paper",
        help="What nothing else says: dfd's own, or the paper's equations to the letter; by default as --edit has it.",
    ),
]
FixOption = Annotated[
    list[str] | None,
    Option(metavar="PLACE[:S]", help="Hold this, and what looks like it, by a strength S from 0 to 1; repeatable."),
]

MadeFieldOption = Annotated[
    Path | None, Option("--field", metavar="FIELD", help="The shape's field; without it, it is found or made.")
]
EncoderOption = Annotated[
    str, Option(metavar="NAME", help="What makes fields: a known name, a folder with weights, or a hub name.")
]
ThresholdOption = Annotated[
    float | None,
    Option(min=0.0, max=1.0, help="The least confidence of an edit; by default 0.39 of a learned metric, else 0.45."),
]
AzimuthOption = Annotated[
    float | None, Option(help="The first side, degrees from the front (+z) to +x; by default where the handles show.")
]
ElevationOption = Annotated[float, Option(min=-90.0, max=90.0, help="From how high up, degrees.")]
ZoomOption = Annotated[float, Option(min=0.01, help="Above 1 nearer, at the handles.")]
ViewsOption = Annotated[int, Option(min=1, max=36, help="From how many sides, all around.")]
ResolutionOption = Annotated[int, Option(min=16, max=8192, help="Pixels along the side of each picture.")]


def open_shape(mesh: Path, field: Path | None, stages: Stages, *, force: bool = False) -> tuple[Mesh, Field | None]:
    """Load a mesh, and its field if one is given; raises as `dfd.load` and `Field.load`."""
    import dfd

    with stages.stage("read"):
        shape = dfd.load(mesh)
        return shape, None if field is None else dfd.Field.load(field, mesh=shape, other_shape=force)


def open_or_distill(
    mesh: Path,
    field: Path | None,
    stages: Stages,
    *,
    force: bool = False,
    encoder: str = DEFAULT_ENCODER,
    preset: Preset | None = None,
) -> tuple[Mesh, Field]:
    """Load a mesh and its field; without `field`, distill one. Raises also as `dfd.distill`."""
    import dfd

    shape, opened = open_shape(mesh, field, stages, force=force)
    if opened is None:
        how: dict[str, Any] = {} if preset is None else {"preset": preset}
        opened = dfd.distill(shape, encoder, progress=stages, **how)
    return shape, opened


class Places:
    """Places that a command line names on a mesh, and what is to be said about them."""

    def __init__(self, mesh: Mesh, session: Deformer | None = None) -> None:
        self._mesh, self._session = mesh, session  # a session knows parts
        self.notes: list[str] = []  # lines for people: what a text that is no vertex index meant

    def find(self, option: str, text: str) -> Place:
        """What of the shape `text` names, as `dfd.editing.points.find` reads it, or with a session a part.

        Raises ValueError in the name of `option`, if it names nothing there.
        """
        from dfd.editing.points import find, place_on

        kind, _, where = text.strip().partition("@")
        if where and kind in ("part", "piece"):
            if self._session is None:
                raise ValueError(f"`{option}` cannot be {text!r} without `--field`: features tell parts")
            part = self._session.part(self.find(option, where), alike=kind == "part")
            self.notes.append(f"{option} {text} is {part}")
            return place_on(self._mesh, part)
        try:
            found = find(self._mesh, text)
        except ArgumentError as error:
            raise ArgumentError(option, error.reason) from None
        if not re.fullmatch(r"\s*[-+]?\d+\s*", text):
            self.notes.append(f"{option} {found.note}")
        return found.place

    def fixed(self, option: str, text: str) -> tuple[Place, float]:
        """A place and the strength with which it is held, 1 if `text` does not end in `:NUMBER`."""
        named, _, last = text.rpartition(":")
        if named in ("", "part", "group", "material", "ball", "box") or not is_number(last):
            return self.find(option, text), 1.0
        strength = check.number(None, option, float(last), minimum=0.0, maximum=1.0)
        return self.find(option, named), strength

    def tell(self) -> None:
        """Print the notes on standard error."""
        for note in self.notes:
            say(note)


def plane_text(text: str) -> str:
    """A plane as `dfd.symmetry.plane.plane_from_text` reads it, for which people may write nx,ny,nz,offset."""
    direction, _, offset = text.rpartition(",")
    return f"{direction}={offset}" if direction.count(",") == 2 and "=" not in text else text


def check_output(option: str, path: Path | None, endings: Sequence[str] = ()) -> None:
    """Refuse, before the work, a file that could not be written after it.

    Raises ValueError in the name of `option`, if `path` has none of the `endings`. Raises OSError if its folder does
    not exist or cannot be written, or it is a folder itself.
    """
    if path is None:
        return
    if endings:
        check.ending(None, option, path, endings)
    if path.is_dir():
        raise IsADirectoryError(f"`{option}`: {path} is a folder, not a file")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"`{option}`: the folder {path.parent} does not exist")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OSError(error.errno, f"`{option}`: {path} cannot be written: {error.strerror}") from error


def file_in(output: Path, source: Path) -> Path:
    """Return the file that `output` names: if it is a folder, the one in it with the name of `source`.

    Raises ValueError if that is `source` itself.
    """
    written = output / source.name if output.is_dir() else output
    if output.is_dir() and written.resolve() == source.resolve():
        raise ValueError(f"`--output` must be another folder than that of {source}, which stays as it is")
    return written


def given_besides(context: typer.Context, names: Sequence[str]) -> list[str]:
    """The options that a command line gives besides those of these `names`, as they are spelled."""
    given = (each for each in context.command.params if each.name not in names and each.name is not None)
    sources = ((each, context.get_parameter_source(each.name or "")) for each in given)
    return [each.opts[0] for each, source in sources if source is not None and source.name == "COMMANDLINE"]


def add_options(command: Command, options: Mapping[str, Any], *, after: str | None = None) -> Command:
    """Let `command`, which takes `**` keywords, have these options, by their annotations; None is not given.

    They come behind the parameter `after`, by default behind all others.
    """
    own = [
        each for each in signature(command, eval_str=True).parameters.values() if each.kind is not Parameter.VAR_KEYWORD
    ]
    added = [Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=kind) for name, kind in options.items()]
    index = len(own) if after is None else [each.name for each in own].index(after) + 1
    keywords = [each.replace(kind=Parameter.KEYWORD_ONLY) for each in own[index:]]
    parameters = [*own[:index], *added, *keywords]
    command.__signature__ = signature(command).replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    return command


def shown(value: Any) -> str:
    """A default as the help of a command says it."""
    if isinstance(value, bool) or value is None:
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)


def chosen_preset(preset: str | None) -> Preset | None:
    """The preset of that name, or None where none was named; ValueError if there is none of that name."""
    return None if preset is None else check.choice(None, "--preset", preset, Preset)


def is_number(text: str) -> bool:
    """Return whether `text` is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
