"""`python -m bench.paper NAME`: write a page that reproduces one figure or table of the paper, with verdicts."""

import argparse
import sys
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from bench.paper.comparisons import JOBS
from bench.paper.figures import CANNOT, FIGURES
from bench.paper.page import write
from bench.paper.subjects import Context
from bench.peers.given import given
from dfd.encoders.known import DEFAULT_ENCODER

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "paper"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the page that the command line names, or list all pages."""
    parser = argparse.ArgumentParser("python -m bench.paper", description=__doc__)
    parser.add_argument(
        "name", metavar="NAME", nargs="?", choices=[*FIGURES, *CANNOT], help="page to write, see --list"
    )
    parser.add_argument("--list", action="store_true", help="list all pages and stop")
    parser.add_argument("--quick", action="store_true", help="use fewer shapes, and fewer and smaller pictures")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    parser.add_argument("--encoder", default=DEFAULT_ENCODER, help="image encoder of all fields (%(default)s)")
    parser.add_argument(
        "--method",
        metavar="MODULE:FUNCTION",
        action="append",
        default=[],
        help="further method in the pages that compare methods, see docs/reference/your_method.md; may be repeated",
    )
    options = parser.parse_args(arguments)
    name = options.name
    if options.list:
        for each, figure in FIGURES.items():
            print(f"{each:8} {figure.title}")
        for each, reason in CANNOT.items():
            print(f"{each:8} cannot be made: {reason}")
        return
    if name is None:
        parser.error("NAME must be one of " + ", ".join(FIGURES))
    if name in CANNOT:
        parser.error(f"{name} cannot be made: {CANNOT[name]}")
    if options.method and (name not in JOBS or JOBS[name].all_handles):
        able = ", ".join(each for each, job in JOBS.items() if not job.all_handles)
        parser.error(f"--method can only be given for a page that compares methods: {able}; got {name}")
    # With --quick, and in ablations, fields have other settings than the paper's, which the pages say.
    warnings.filterwarnings("ignore", "Deformer: `preset` is 'paper', but the field", UserWarning)
    try:
        methods = {each.rpartition(":")[2]: given(each) for each in options.method}
        context = Context(options.quick, options.encoder, partial(print, file=sys.stderr), methods)
        print(write(FIGURES[name], name, options.output, context))
    except (ValueError, OSError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
