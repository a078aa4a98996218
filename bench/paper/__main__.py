"""`python -m bench.paper NAME`: one figure or table of the paper, as a page of pictures and numbers."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from bench.paper import comparisons, controls, features, resolution
from bench.paper.page import BALL, Context, Page, write
from dfd.encoders.known import DEFAULT_ENCODER

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "paper"
# Every page by its name; the first line of its docstring says what it shows.
PAGES: dict[str, Callable[[Context], Page]] = {
    name: page
    for module in (features, controls, comparisons, resolution)
    for name, page in sorted(vars(module).items())
    if re.fullmatch(r"(fig|table)\d+", name)
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Make one page, or list them."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.list:
        for name, page in PAGES.items():
            print(f"{name:8} {(page.__doc__ or '').splitlines()[0]}")
        return
    if options.name is None:
        parser.error("NAME must be one of " + ", ".join(PAGES))
    console = Console(stderr=True, highlight=False)
    if options.meshes is not None and not options.meshes.is_dir():
        parser.error(f"{options.meshes} is not a folder")
    context = Context(
        folder=options.meshes,
        quick=options.quick,
        encoder=options.encoder,
        ball=options.ball,
        say=lambda line: console.print(line, markup=False, soft_wrap=True),
    )
    try:
        page = PAGES[options.name](context)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    path = write(page, options.name, options.output, context)
    Console().print(f"{path}", highlight=False, soft_wrap=True)


def _radius(text: str) -> float:
    value = float(text)
    if not 0 <= value < 1:
        raise ValueError
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bench.paper", description=__doc__)
    parser.add_argument("name", metavar="NAME", nargs="?", choices=PAGES, help="of the page, see --list")
    parser.add_argument("--list", action="store_true", help="list the pages and stop")
    parser.add_argument("--meshes", type=Path, help="folder whose meshes are shown; else those that DFD_MESHES has")
    parser.add_argument("--quick", action="store_true", help="fewer and smaller pictures, fewer shapes")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    parser.add_argument("--encoder", default=DEFAULT_ENCODER, help="of all fields (%(default)s)")
    ball = "radius, of the longest side, in which other methods get a point's neighbors too; 0 for none (%(default)s)"
    parser.add_argument("--ball", type=_radius, default=BALL, help=ball)
    return parser


if __name__ == "__main__":
    main()
