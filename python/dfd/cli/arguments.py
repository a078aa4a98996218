"""What several commands take: the mesh, the field, points on the shape, and files to write."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from dfd.editing.place import Place
    from dfd.mesh.mesh import Mesh

__all__ = ["FieldOption", "MeshArgument", "check_output", "place"]

MeshArgument = Annotated[Path, typer.Argument(metavar="MESH", help="OBJ, PLY, STL, OFF, GLB or glTF file.")]
FieldOption = Annotated[
    Path, typer.Option("--field", metavar="FIELD", help="The shape's field, as `dfd distill` wrote it.")
]


def place(mesh: Mesh, option: str, text: str) -> Place:
    """What of the shape `text` names, as `dfd.editing.place.find` reads it.

    Raises
    ------
    ValueError
        In the name of `option`, if it is neither, or there is no such vertex.
    """
    from dfd.editing.place import find

    try:
        return find(mesh, text).place
    except ValueError as error:
        raise ValueError(re.sub(r"^(\w+: )?`at`", f"`{option}`", str(error))) from None


def check_output(option: str, path: Path | None, endings: Sequence[str] = ()) -> None:
    """Refuse, before the work, a file that could not be written after it.

    Raises
    ------
    ValueError
        In the name of `option`, if `path` has none of the `endings`.
    OSError
        If its folder does not exist or cannot be written, or it is a folder itself.
    """
    if path is None:
        return
    if endings and not path.name.lower().endswith(tuple(endings)):
        raise ValueError(f"`{option}` must end in {', '.join(endings)}, got {path}")
    if path.is_dir():
        raise IsADirectoryError(f"`{option}`: {path} is a folder, not a file")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"`{option}`: the folder {path.parent} does not exist")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OSError(error.errno, f"`{option}`: {path} cannot be written: {error.strerror}") from error
