"""`python -m bench.paper NAME`: one figure or table of the paper, as a page of pictures and numbers."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from bench.paper.figures import CANNOT, FIGURES, PAGES
from bench.paper.page import write
from bench.paper.subjects import Context
from dfd.encoders.known import DEFAULT_ENCODER

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "paper"


def main(arguments: Sequence[str] | None = None) -> None:
    """Make one page, or list them."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.list:
        for name, page in PAGES.items():
            print(f"{name:8} {(page.__doc__ or '').splitlines()[0]}")
        for name, reason in CANNOT.items():
            print(f"{name:8} cannot be made: {reason}")
        return
    if options.name is None:
        parser.error("NAME must be one of " + ", ".join(PAGES))
    if options.name in CANNOT:
        parser.error(f"{options.name} cannot be made: {CANNOT[options.name]}")
    console = Console(stderr=True, highlight=False)
    # Pages say which fields were made with --quick, or otherwise changed.
    warnings.filterwarnings("ignore", "Deformer: `preset` 'paper'", UserWarning)
    if options.meshes is not None and not options.meshes.is_dir():
        parser.error(f"{options.meshes} is not a folder")
    context = Context(
        folder=options.meshes,
        quick=options.quick,
        encoder=options.encoder,
        say=lambda line: console.print(line, markup=False, soft_wrap=True),
    )
    try:
        path = write(PAGES[options.name], FIGURES[options.name], options.name, options.output, context)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    Console().print(f"{path}", highlight=False, soft_wrap=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bench.paper", description=__doc__)
    parser.add_argument("name", metavar="NAME", nargs="?", choices=[*PAGES, *CANNOT], help="of the page, see --list")
    parser.add_argument("--list", action="store_true", help="list the pages and stop")
    parser.add_argument("--meshes", type=Path, help="folder whose meshes are shown; else those that DFD_MESHES has")
    parser.add_argument("--quick", action="store_true", help="fewer and smaller pictures, fewer shapes")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    parser.add_argument("--encoder", default=DEFAULT_ENCODER, help="of all fields (%(default)s)")
    return parser


if __name__ == "__main__":
    main()
