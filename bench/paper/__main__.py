"""`python -m bench.paper NAME`: write a page that reproduces one figure or table of the paper."""

import argparse
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from bench.paper.figures import CANNOT, FIGURES, PAGES
from bench.paper.page import write
from bench.paper.subjects import Context
from dfd.encoders.known import DEFAULT_ENCODER

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "paper"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the page that the command line names, or list all pages."""
    parser = argparse.ArgumentParser("python -m bench.paper", description=__doc__)
    parser.add_argument("name", metavar="NAME", nargs="?", choices=[*PAGES, *CANNOT], help="page to write, see --list")
    parser.add_argument("--list", action="store_true", help="list all pages and stop")
    parser.add_argument("--quick", action="store_true", help="use fewer shapes, and fewer and smaller pictures")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    parser.add_argument("--encoder", default=DEFAULT_ENCODER, help="image encoder of all fields (%(default)s)")
    options = parser.parse_args(arguments)
    name = options.name
    if options.list:
        for each, page in PAGES.items():
            print(f"{each:8} {(page.__doc__ or '').splitlines()[0]}")
        for each, reason in CANNOT.items():
            print(f"{each:8} cannot be made: {reason}")
        return
    if name is None:
        parser.error("NAME must be one of " + ", ".join(PAGES))
    if name in CANNOT:
        parser.error(f"{name} cannot be made: {CANNOT[name]}")
    # With --quick, and in ablations, fields have other settings than the paper's, which the pages say.
    warnings.filterwarnings("ignore", "Deformer: `preset` is 'paper', but the field", UserWarning)
    context = Context(options.quick, options.encoder, say=partial(print, file=sys.stderr))
    try:
        print(write(PAGES[name], FIGURES[name], name, options.output, context))
    except (ValueError, OSError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
