"""Open the meshes, fields and places that command-line arguments name, and check that output files can be written."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.batch.inputs import MESH_ENDINGS
from dfd.cli.errors import say
from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.files import resolved_target
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.common.progress import Stages
    from dfd.editing.deformer import Deformer
    from dfd.editing.points import Place
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

OF_THE_FIELD = re.compile(r"\s*(part|piece)@.")  # places that only the features of a field define
# Formats of other programs, which Blender or another converter can turn into GLB.
CONVERTIBLE = re.compile(r"\.(fbx|usd[acz]?|dae|blend|3ds|abc|3mf|max|ma|mb|c4d|step|stp|iges|igs|x3d|wrl|vrm)")


def open_field(
    mesh: Mesh,
    field: Path | None,
    *,
    force: bool = False,
    encoder: str = DEFAULT_ENCODER,
    preset: Preset | None = None,
    progress: bool | Stages = True,
) -> Field:
    """Load the field of `mesh` from the file `field`. If `field` is None, read it from the cache or distill it.

    With `force`, the file may contain the field of another shape. Raises the errors of `Field.load` and `dfd.distill`.
    """
    import dfd

    if field is None:
        return dfd.distill(mesh, encoder, progress=progress, preset=preset or "default")
    return dfd.Field.load(field, mesh=mesh, other_shape=force)


def open_mesh(path: Path, stages: Stages | None = None) -> Mesh:
    """Read the mesh in the file `path`. Raises ValueError with advice for folders and for formats of other programs."""
    from dfd import load

    if path.is_dir():
        inside = sorted(each.name for each in path.iterdir() if each.suffix.lower() in MESH_ENDINGS)
        example = f", such as {path / inside[0]}" if inside else ""
        raise ValueError(f"`MESH` must be a file, but {path} is a folder: name one mesh in it{example}")
    if CONVERTIBLE.fullmatch(path.suffix.lower()):
        advice = "convert it to GLB, for example in Blender (File, Export, glTF 2.0)"
        raise ValueError(f"`MESH` must end in {', '.join(MESH_ENDINGS)}, got {path}: {advice}")
    with nullcontext() if stages is None else stages.stage("read"):
        return load(path)


def preset_of(preset: Preset | None, *edits: Path | None) -> Preset:
    """Return `preset`. If it is None, return the preset of all `edits`, or "default" if they differ or cannot be read.

    Errors in the files are reported when the edits are opened.
    """
    if preset is not None:
        return preset
    found = set()
    for edit in edits:
        with suppress(OSError, ValueError, AttributeError):
            found.add(None if edit is None else json.loads(edit.read_text("utf-8-sig")).get("preset"))
    return "paper" if found == {"paper"} else "default"


def open_session(
    shape: Mesh, field: Path | None, stages: Stages, edit: Path | None, preset: Preset | None, **how: Any
) -> Deformer:
    """Open a session of a mesh, with the edit in the file `edit` if given. `how` are arguments of `open_field`.

    If `preset` is None, the preset of the edit also applies to a field that is distilled.
    """
    from dfd import Deformer
    from dfd.editing.edit import with_preset
    from dfd.editing.edit_file import read_edit

    opened = open_field(shape, field, preset=preset_of(preset, edit), progress=stages, **how)
    other = {"other_shape": how.get("force", False)}
    if edit is None:
        return Deformer(shape, opened, preset=preset or "default", **other)
    if preset is None:
        return Deformer.load(edit, shape, opened, **other)
    session = Deformer(shape, opened, preset=preset, **other)
    session.apply(with_preset(read_edit(edit, shape, **other), preset, shape))
    return session


def find_place(option: str, text: str, mesh: Mesh, session: Deformer | None = None, *, quiet: bool = False) -> Place:
    """Return the place that `text` names on `mesh` (`dfd.editing.points.find`).

    With a session, the text may name a part. If the text is no vertex index, also print the place that was found,
    unless `quiet`.
    Raises ValueError with the name of `option` if the text names no place.
    """
    from dfd.editing.points import find
    from dfd.editing.verbs import place_of

    try:
        if session is not None and OF_THE_FIELD.match(text):
            place = place_of(session.bound, text)
            note = f"{text} is {place}"
        else:
            place, note = find(mesh, text)
    except ArgumentError as error:
        raise ArgumentError(option, error.reason) from None
    if not quiet and not re.fullmatch(r"\s*[-+]?\d+\s*", text):
        say(f"{option} {note}")
    return place


def hold(session: Deformer, handles: Iterable[tuple[str, dict[str, Any]]], fix: Iterable[str] | None) -> None:
    """Add handles and fixed points to a session. A text of `fix` may end with a strength, as in "812:0.5"."""
    for text, given in handles:
        session.add(find_place("--handle", text, session.mesh, session), **given)
    for text, strength in map(fixed_place, fix or ()):
        session.fix(find_place("--fix", text, session.mesh, session), strength=strength)


def fixed_place(text: str) -> tuple[str, float]:
    """Return the place and the strength in a value of `--fix`, such as "812:0.5"."""
    named, _, last = text.rpartition(":")
    if named in ("", "part", "group", "material", "ball", "box") or not is_number(last):
        return text, 1.0
    return named, check.number(None, "--fix", float(last), minimum=0.0, maximum=1.0)


def check_output(option: str, path: Path | None, endings: Sequence[str] = ()) -> None:
    """Check, before slow work begins, that the file `path` can be written.

    Raises ValueError with the name of `option` if `path` has none of the `endings`. Raises OSError if no file can be
    written to the folder, or `path` exists and is no regular file.
    """
    if path is None:
        return
    if endings:
        check.ending(None, option, path, endings)
    folder = resolved_target(path, option).parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OSError(error.errno, f"`{option}`: {path} cannot be written: {error.strerror}") from error


def file_in(output: Path, source: Path, *, ending: str | None = None, replace: bool | None = None) -> Path:
    """Return `output`. If `output` is a folder, return the file with the name of `source` in this folder.

    `ending` replaces the ending of that name. Raises ValueError if the result is `source` itself, unless `replace`.
    """
    written = output / (source.name if ending is None else source.with_suffix(ending).name)
    written = written if output.is_dir() else output
    if not replace and written.exists() and source.exists() and written.samefile(source):
        remedy = "give another file or folder" + ("" if replace is None else ", or `--force` to replace the input")
        raise ValueError(f"`--output` must not be the input, got {written}: {remedy}")
    return written


def is_number(text: str) -> bool:
    """Return whether `text` is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
