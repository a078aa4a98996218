"""The command `dfd deform` for several shapes: transfer one edit to each shape."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dfd.batch.inputs import MESH_ENDINGS, matches
from dfd.cli.arguments import check_output, file_in, open_field, preset_of
from dfd.cli.errors import say
from dfd.common.errors import ArgumentError, one_line

if TYPE_CHECKING:
    from dfd.batch.one_edit import Original
    from dfd.common.preset import Preset
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

    FieldOf = Callable[[Path, Mesh], Field]  # returns the field for a file and its mesh

CELL = 280  # width and height of a picture on the sheet, pixels
PICTURES_IN_A_ROW, SHAPES_ON_A_SHEET = 6, 60  # each shape has two pictures
SOME_LEFT_OUT = 1  # exit code if a shape is left out


def deform_many(
    meshes: Sequence[str],
    edit: Path,
    output: Path,
    *,
    fields: Path | None,
    made_on: Path | None,
    preset: Preset | None,
    threshold: float | None,
    force: bool,
    sheet: Path | None,
    **how: Any,
) -> None:
    """Transfer the edit to every shape, and write the deformed shapes. Exit with code 1 if some shapes are left out.

    `fields` is a folder of fields. `preset` applies to the edit and to new fields; None takes the
    preset of the edit. `how` are arguments of `open_field`.
    """
    files = list(dict.fromkeys(path for pattern in meshes for path in matches(pattern)))
    _check(files, output, fields, sheet)

    import dfd
    from dfd.batch.one_edit import UnlikeError, carry, field_path
    from dfd.editing.edit import with_preset
    from dfd.pictures.contact_sheet import contact_sheet
    from dfd.pictures.picture import picture, save_png
    from dfd.pictures.sheet import session_views

    def field_of(file: Path, shape: Mesh) -> Field:
        """Read the field from its file. If there is no file, read the field from the cache, or distill the field."""
        path = field_path(file, fields)
        return open_field(shape, path if path.is_file() else None, preset=preset_of(preset, edit), force=force, **how)

    original = _original(edit, files, made_on, field_of)
    if preset is not None:
        original = replace(original, edit=with_preset(original.edit, preset, original.mesh))
    output.mkdir(exist_ok=True)
    cells: list[tuple[Any, str]] = []  # pictures with captions, two of each shape
    left_out = 0
    for file in files:
        shape = None
        try:
            shape = dfd.load(file)
            carried = carry(original, shape, field_of(file, shape), threshold=threshold, force=force)
            written = file_in(output, file)
            shape.save(written, carried.deformer.vertices)
            carried.deformer.save(output / f"{file.stem}.edit.json")
            sure = f"confidence {_listed(carried.confidence, carried.unsure)}"
            say(f"{written}: {sure}; {carried.deformer.report()}", result=True)
            if len(cells) < 2 * SHAPES_ON_A_SHEET:
                views = session_views(carried.deformer)
                drawn = [picture(shape, resolution=CELL, **views[name]) for name in ("before", "after")]
                cells += zip(drawn, (file.name, sure), strict=True)
        except (ValueError, OSError, MemoryError) as error:
            left_out += 1
            why = one_line(error.reason if isinstance(error, ArgumentError) else error)
            if isinstance(error, UnlikeError) and len(error.confidence) > 1:
                why = f"{why} ({_listed(error.confidence)})"
            say(f"dfd: {file} is left out: {why}")
            if shape is not None and len(cells) < 2 * SHAPES_ON_A_SHEET:
                resting = picture(shape, resolution=CELL)
                cells += [(resting, file.name), (resting * 0 + 255, f"left out: {why}")]
    told = f"{len(files) - left_out} of {len(files)} shapes{f', {left_out} left out' if left_out else ''}"
    if cells:
        sheet = sheet or output / "sheet.png"
        rows = [("", cells[i : i + PICTURES_IN_A_ROW]) for i in range(0, len(cells), PICTURES_IN_A_ROW)]
        save_png(sheet, contact_sheet(rows, title=edit.name, cell=CELL))
        told += f"; {sheet}{f' shows {len(cells) // 2} of them' if len(files) > SHAPES_ON_A_SHEET else ''}"
    say(told)
    if left_out:
        raise typer.Exit(SOME_LEFT_OUT)


def _check(files: Sequence[Path], output: Path, fields: Path | None, sheet: Path | None) -> None:
    """Check, before slow work begins, that all files have valid and distinct names, and can be written."""
    if output.exists() and not output.is_dir():
        raise NotADirectoryError(f"`--output` must be a folder for several shapes, got {output}")
    taken: dict[str, Path] = {}
    for file in files:
        if file.suffix.lower() not in MESH_ENDINGS:
            raise ValueError(f"`MESH` must end in {', '.join(MESH_ENDINGS)}, got {file}")
        before = taken.setdefault(file.stem.lower(), file)
        if before is not file:
            raise ValueError(f"`MESH`: {before} and {file} would have the same name in {output}")
        file_in(output, file)
    if fields is not None and not fields.is_dir():
        raise NotADirectoryError(f"`--field` must be a folder for several shapes, got {fields}")
    check_output("--output", output / "probe" if output.is_dir() else output)
    if sheet is not None:
        inside = sheet.parent == output and not output.exists()
        check_output("--picture", Path(sheet.name) if inside else sheet, (".png",))


def _original(edit: Path, files: Sequence[Path], made_on: Path | None, field_of: FieldOf) -> Original:
    """Return the edit with its mesh: `made_on`, or the one of `files` with its mesh hash, or the mesh that it names."""
    import dfd
    from dfd.batch.one_edit import Original, find_files

    if made_on is not None:
        shape = dfd.load(made_on)
        return Original.read(edit, shape, field_of(made_on, shape))
    with suppress(KeyError, TypeError, ValueError):  # the edit has no hash, or is invalid, which `find_files` reports
        recorded = json.loads(edit.read_text("utf-8-sig"))["mesh"]["hash"]
        for file in files:
            with suppress(ValueError, OSError):  # a file that cannot be read is reported later
                shape = dfd.load(file)
                if shape.content_hash == recorded:
                    return Original.read(edit, shape, field_of(file, shape))
    return find_files(edit).original()


def _listed(confidence: Mapping[str, float], unsure: Sequence[str] = ()) -> str:
    return ", ".join(f"{name} {sure:.2f}{' (unsure)' if name in unsure else ''}" for name, sure in confidence.items())
