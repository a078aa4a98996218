"""`dfd deform` of several shapes: one edit, carried to each in turn."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dfd.batch.inputs import MESH_ENDINGS, has_magic, matches
from dfd.cli.arguments import check_output, file_in
from dfd.cli.errors import say

if TYPE_CHECKING:
    from dfd.batch.one_edit import Original
    from dfd.common.preset import Preset
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

CELL = 280  # pixels along a picture of the sheet
SHAPES_BESIDE, SHAPES_ON_A_SHEET = 3, 60
SOME_LEFT_OUT = 1  # exit code


@dataclass(frozen=True)
class ManyOptions:
    """The options of a command for several shapes."""

    edit: Path
    output: Path
    fields: Path | None  # a folder
    made_on: Path | None
    encoder: str
    preset: Preset | None  # replaces the edit's own, and that of fields that are made
    threshold: float | None  # None goes by the field
    force: bool  # whether less sure handles are carried as well
    sheet: Path | None


def is_many(meshes: Sequence[str], made_on: Path | None) -> bool:
    """Return whether a command line names several shapes."""
    return len(meshes) > 1 or made_on is not None or has_magic(meshes[0])


def deform_many(meshes: Sequence[str], options: ManyOptions) -> None:
    """Carry the edit to every shape and write each that it fits; exit with code 1 if some were left out."""
    files = list(dict.fromkeys(path for pattern in meshes for path in matches(pattern)))
    _check(files, options)

    import dfd
    from dfd.batch.one_edit import UnlikeError, before_and_after, carry
    from dfd.editing.edit import with_preset
    from dfd.pictures.contact_sheet import contact_sheet
    from dfd.pictures.picture import picture, save_png

    original = _original(files, options)
    if options.preset is not None:
        original = replace(original, edit=with_preset(original.edit, options.preset, original.mesh))
    options.output.mkdir(exist_ok=True)
    cells: list[tuple[tuple[Any, str], tuple[Any, str]]] = []
    left_out = 0
    for file in files:
        shape = None
        try:
            shape = dfd.load(file)
            field = _field(file, shape, options)
            carried = carry(original, shape, field, threshold=options.threshold, force=options.force)
            output = file_in(options.output, file)
            shape.save(output, carried.deformer.vertices)
            carried.deformer.save(options.output / f"{file.stem}.edit.json")
            sure = _listed(carried.confidence, carried.unsure)
            say(f"{output}: {sure}; {carried.deformer.report()}", result=True)
            if len(cells) < SHAPES_ON_A_SHEET:
                before, after = before_and_after(carried.deformer, resolution=CELL)
                cells.append(((before, file.name), (after, sure)))
        except (ValueError, OSError, MemoryError) as error:
            left_out += 1
            why = " ".join(str(error).split())
            if isinstance(error, UnlikeError) and len(error.confidence) > 1:
                why = f"{why} ({_listed(error.confidence)})"
            say(f"dfd: {file} is left out: {why}")
            if shape is not None and len(cells) < SHAPES_ON_A_SHEET:
                drawn = picture(shape, resolution=CELL)
                cells.append(((drawn, file.name), (drawn * 0 + 255, f"left out: {why}")))
    told = f"{len(files) - left_out} of {len(files)} shapes{f', {left_out} left out' if left_out else ''}"
    if cells:
        sheet = options.sheet or options.output / "sheet.png"
        rows = [cells[start : start + SHAPES_BESIDE] for start in range(0, len(cells), SHAPES_BESIDE)]
        pictures = [("", [each for cell in row for each in cell]) for row in rows]
        save_png(sheet, contact_sheet(pictures, title=options.edit.name, cell=CELL))
        told += f"; {sheet}{f' shows {len(cells)} of them' if len(files) > SHAPES_ON_A_SHEET else ''}"
    say(told)
    if left_out:
        raise typer.Exit(SOME_LEFT_OUT)


def _check(files: Sequence[Path], options: ManyOptions) -> None:
    """Refuse, before the work, what could not be written after it."""
    taken: dict[str, Path] = {}
    for file in files:
        if file.suffix.lower() not in MESH_ENDINGS:
            raise ValueError(f"`MESH` must end in {', '.join(MESH_ENDINGS)}, got {file}")
        before = taken.setdefault(file.stem.lower(), file)
        if before is not file:
            raise ValueError(f"`MESH`: {before} and {file} would have one name in {options.output}")
        file_in(options.output, file)
    if options.output.exists() and not options.output.is_dir():
        raise NotADirectoryError(f"`--output` must be a folder for several shapes, got {options.output}")
    check_output("--output", options.output / "probe" if options.output.is_dir() else options.output)
    if options.sheet is not None:
        inside = options.sheet.parent == options.output and not options.output.exists()
        check_output("--picture", Path(options.sheet.name) if inside else options.sheet, (".png",))
    if options.fields is not None and not options.fields.is_dir():
        raise NotADirectoryError(f"`--field` must be a folder for several shapes, got {options.fields}")


def _original(files: Sequence[Path], options: ManyOptions) -> Original:
    """The edit with its shape: the given one, that of the files whose hash it records, or the one it names."""
    import dfd
    from dfd.batch.one_edit import Original, find_files

    if options.made_on is not None:
        shape = dfd.load(options.made_on)
        return Original.read(options.edit, shape, _field(options.made_on, shape, options))
    with suppress(KeyError, TypeError, ValueError):  # an edit without the hash of its mesh; `find_files` refuses others
        recorded = json.loads(options.edit.read_text("utf-8-sig"))["mesh"]["hash"]
        for file in files:
            with suppress(ValueError, OSError):  # a file that cannot be read is told when its turn comes
                shape = dfd.load(file)
                if shape.content_hash == recorded:
                    return Original.read(options.edit, shape, _field(file, shape, options))
    return find_files(options.edit).original()


def _field(file: Path, shape: Mesh, options: ManyOptions) -> Field:
    """The field of a shape: from a file beside it or in `--field`, from the cache, or made now."""
    import dfd
    from dfd.batch.one_edit import field_path

    path = field_path(file, options.fields)
    if path.is_file():
        return dfd.Field.load(path, mesh=shape, other_shape=options.force)
    chosen: dict[str, Any] = {} if options.preset is None else {"preset": options.preset}
    return dfd.distill(shape, options.encoder, **chosen)


def _listed(confidence: Mapping[str, float], unsure: Sequence[str] = ()) -> str:
    return ", ".join(f"{name} {sure:.2f}{' (unsure)' if name in unsure else ''}" for name, sure in confidence.items())
