"""`dfd deform` of several shapes: one edit, carried to each."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dfd.batch.inputs import MESH_ENDINGS, has_magic, local_matches
from dfd.cli.arguments import check_output, file_in

if TYPE_CHECKING:
    from dfd.batch.one_edit import Original
    from dfd.common.preset import Preset
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

CELL = 280  # pixels along a picture of the sheet
SHAPES_BESIDE, SHAPES_ON_A_SHEET = 3, 60
SOME_LEFT_OUT = 1  # exit code


@dataclass(frozen=True)
class BatchOptions:
    """What is to be done to the shapes."""

    edit: Path
    output: Path
    fields: Path | None  # a folder
    made_on: Path | None
    encoder: str
    preset: Preset | None  # in place of the edit's own, and by what missing fields are made
    threshold: float | None  # None goes by the field
    force: bool  # whether what is less sure is carried as well
    sheet: Path | None


@dataclass
class _Sheet:
    """Pictures of shapes on pages, in the order in which they come."""

    path: Path
    title: str
    cells: list[list[tuple[Any, str]]] = field(default_factory=list)

    def save(self) -> list[Path]:
        """Write the pages, and say where."""
        from dfd.pictures.contact_sheet import contact_sheet
        from dfd.pictures.picture import save_png

        written = []
        for page, start in enumerate(range(0, len(self.cells), SHAPES_ON_A_SHEET), 1):
            cells = self.cells[start : start + SHAPES_ON_A_SHEET]
            beside = [cells[i : i + SHAPES_BESIDE] for i in range(0, len(cells), SHAPES_BESIDE)]
            rows = [("", [picture for cell in row for picture in cell]) for row in beside]
            path = self.path if page == 1 else self.path.with_stem(f"{self.path.stem}-{page}")
            save_png(path, contact_sheet(rows, title=self.title, cell=CELL))
            written.append(path)
        return written


def is_many(meshes: Sequence[str], made_on: Path | None) -> bool:
    """Whether a command line speaks of several shapes rather than of one."""
    return len(meshes) > 1 or made_on is not None or (has_magic(meshes[0]) and not Path(meshes[0]).exists())


def deform_many(meshes: Sequence[str], options: BatchOptions) -> None:
    """Carry the edit to every shape and write each that it fits; leave with code 1 if some were left out."""
    files = _files(meshes)
    _check(files, options)

    import dfd
    from dfd.batch.one_edit import UnlikeError, before_and_after, carry
    from dfd.editing.edit import with_preset
    from dfd.pictures.picture import picture

    original = _original(files, options)
    if options.preset is not None:
        original = replace(original, edit=with_preset(original.edit, options.preset, original.mesh))
    options.output.mkdir(exist_ok=True)
    sheet = _Sheet(options.sheet or options.output / "sheet.png", options.edit.name)
    left_out = 0
    for file in files:
        shape = None
        try:
            shape = dfd.load(file)
            carried = carry(
                original, shape, _field(file, shape, options), threshold=options.threshold, force=options.force
            )
            output = file_in(options.output, file)
            shape.save(output, carried.deformer.vertices)
            carried.deformer.save(options.output / f"{file.stem}.edit.json")
            sure = _listed(carried.confidence, carried.unsure)
            before, after = before_and_after(carried.deformer, resolution=CELL)
            sheet.cells.append([(before, file.name), (after, sure)])
            typer.echo(f"{output}: {sure}; {carried.deformer.report()}")
        except (ValueError, OSError, MemoryError) as error:
            left_out += 1
            why = " ".join(str(error).split())
            if isinstance(error, UnlikeError) and len(error.confidence) > 1:
                why = f"{why} ({_listed(error.confidence)})"
            if shape is not None:
                drawn = picture(shape, resolution=CELL)
                sheet.cells.append([(drawn, file.name), (drawn * 0 + 255, f"left out: {why}")])
            typer.echo(f"dfd: {file} is left out: {why}", err=True)
    written = sheet.save() if sheet.cells else []
    told = f"{len(files) - left_out} of {len(files)} shapes"
    typer.echo(f"{told}{f', {left_out} left out' if left_out else ''}; {', '.join(map(str, written))}", err=True)
    if left_out:
        raise typer.Exit(SOME_LEFT_OUT)


def _files(patterns: Sequence[str]) -> list[Path]:
    """The files that arguments name, each once."""
    found: dict[Path, None] = {}
    for pattern in patterns:
        if has_magic(pattern) and not Path(pattern).exists():
            found |= dict.fromkeys(local_matches(pattern))
        elif not Path(pattern).is_file():
            raise FileNotFoundError(f"MESH: {pattern} does not exist or is no file")
        else:
            found[Path(pattern)] = None
    return list(found)


def _check(files: Sequence[Path], options: BatchOptions) -> None:
    """Refuse, before the work, what could not be written after it."""
    for file in files:
        if file.suffix.lower() not in MESH_ENDINGS:
            raise ValueError(f"MESH must end in {', '.join(MESH_ENDINGS)}, got {file}")
    taken: dict[str, Path] = {}
    for file in files:
        before = taken.setdefault(file.stem.lower(), file)
        if before is not file:
            raise ValueError(f"MESH: {before} and {file} would have one name in {options.output}")
        file_in(options.output, file)
    if options.output.exists() and not options.output.is_dir():
        raise NotADirectoryError(f"`--output` must be a folder for several shapes, got {options.output}")
    check_output("--output", options.output / "probe" if options.output.is_dir() else options.output)
    if options.sheet is not None:
        inside = options.sheet.parent == options.output and not options.output.exists()
        check_output("--picture", Path(options.sheet.name) if inside else options.sheet, (".png",))
    if options.fields is not None and not options.fields.is_dir():
        raise NotADirectoryError(f"`--field` must be a folder for several shapes, got {options.fields}")


def _original(files: Sequence[Path], options: BatchOptions) -> Original:
    """The edit and the shape that it was made on: what is named, the one of the files that it fits, or what it says."""
    import dfd
    from dfd.batch.one_edit import Original
    from dfd.batch.prepare import find_files
    from dfd.editing.edit_file import read_made_on

    if options.made_on is not None:
        shape = dfd.load(options.made_on)
        return Original.read(options.edit, shape, _field(options.made_on, shape, options))
    recorded = _recorded(options.edit)
    for file in files:
        with suppress(ValueError, OSError):  # what cannot be read is told when its turn comes
            shape = dfd.load(file)
            if shape.content_hash == recorded:
                return Original.read(options.edit, shape, _field(file, shape, options))
    if read_made_on(options.edit)[0] is not None:
        _, mesh, field = find_files(options.edit)
        shape = dfd.load(mesh)
        return Original.read(options.edit, shape, dfd.Field.load(field, mesh=shape))
    raise ValueError(f"`--made-on` must name the mesh that {options.edit} was made on: it is none of the shapes")


def _recorded(edit: Path) -> str | None:
    """The hash of the mesh that an edit was made on, where it says so."""
    try:
        return str(json.loads(edit.read_text("utf-8-sig"))["mesh"]["hash"])
    except (KeyError, TypeError, ValueError):
        return None


def _field(file: Path, shape: Mesh, options: BatchOptions) -> Field:
    """The field of a shape: from a file beside it or in `--field`, from the cache, or made now."""
    import dfd
    from dfd.batch.one_edit import field_path

    path = field_path(file, options.fields)
    if path.is_file():
        return dfd.Field.load(path, mesh=shape, other_shape=options.force)
    chosen: dict[str, Any] = {} if options.preset is None else {"preset": options.preset}
    return dfd.distill(shape, options.encoder, **chosen)


def _listed(confidence: dict[str, float], unsure: Sequence[str] = ()) -> str:
    return ", ".join(f"{name} {sure:.2f}{' (unsure)' if name in unsure else ''}" for name, sure in confidence.items())
