"""`python -m bench.paper FOLDER`: ours, ARAP and biharmonic on a set of handles, one table and one page of pictures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from rich.console import Console

import dfd
from bench.paper.compare import Row, compare
from bench.paper.handles import Case, Found, find
from bench.paper.methods import BALL
from bench.paper.page import pictures, to_csv, to_markdown
from dfd.common.files import atomic_write
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.pictures.picture import contact_sheet, save_png

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "paper"
RESOLUTION = 320


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare all cases of the folder; 1 if one of them could not be read."""
    parser = _parser()
    options = parser.parse_args(arguments)
    console = Console(stderr=True, highlight=False)
    try:
        found = find(options.folder)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    rows: list[Row] = []
    page = []
    unread = 0
    for number, each in enumerate(found, 1):
        console.print(f"{number} of {len(found)}: {each.name}", markup=False, soft_wrap=True)
        try:
            case = each.read()
        except (ValueError, OSError) as error:
            unread += 1
            rows.append(Row(each.name, "", note=" ".join(str(error).split())))
            console.print(f"  {error}", markup=False, soft_wrap=True)
        else:
            own = _compare(each, case, options)
            rows += own
            page.append((each.name, pictures(case, own, RESOLUTION)))
        _write(options.output, rows, options)  # after every case: a long run that is cut short has told what it knew
    if page:
        title = "Source, ours, ARAP and biharmonic"
        save_png(options.output / "paper.png", contact_sheet(page, title=title, cell=RESOLUTION))
    Console().print(f"{options.output / 'paper.md'}", highlight=False, soft_wrap=True)
    return 1 if unread else 0


def field_path(found: Found, folder: Path | None) -> Path:
    """Where the field of a case is looked for: beside its mesh, or in `folder` under the name of the shape's folder."""
    if folder is None:
        return found.mesh.with_name(f"{found.mesh.stem}.field.safetensors")
    return folder / f"{found.mesh.parent.name}.field.safetensors"


def _compare(found: Found, case: Case, options: argparse.Namespace) -> list[Row]:
    @cache
    def field() -> dfd.Field:
        path = field_path(found, options.field_folder)
        return dfd.Field.load(path) if path.exists() else dfd.distill(case.mesh, options.encoder)

    return compare(found.name, case, field, options.ball)


def _write(output: Path, rows: Sequence[Row], options: argparse.Namespace) -> None:
    heading = (
        f"Set: {options.folder.resolve().name}. Fields from files, or distilled from {options.encoder}; ARAP and "
        f"biharmonic are given what lies within {options.ball:g} of the longest side from a handle or a fixed point."
    )
    output.mkdir(parents=True, exist_ok=True)
    for name, text in (("paper.csv", to_csv(rows)), ("paper.md", to_markdown(rows, heading))):
        with atomic_write(output / name) as temporary:
            temporary.write_text(text, "utf-8")


def _radius(text: str) -> float:
    value = float(text)
    if not 0 <= value < 1:
        raise ValueError
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bench.paper", description=__doc__)
    parser.add_argument("folder", type=Path, help="of one shape, or holding those of several: see bench.paper.handles")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    parser.add_argument(
        "--field-folder", type=Path, help="where fields are, SHAPE.field.safetensors; by default beside the meshes"
    )
    parser.add_argument("--encoder", default=DEFAULT_ENCODER, help="of shapes without a field (%(default)s)")
    parser.add_argument(
        "--ball",
        type=_radius,
        default=BALL,
        help="radius, of the longest side, in which other methods are given a point's neighbors as well; 0 gives none, "
        "as in the paper's Fig. 15 (%(default)s)",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
