"""`python -m bench.paper NAME`: one figure or table of the paper, as a page of pictures and numbers."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from rich.console import Console

from bench.paper.context import BALL, Context
from bench.paper.report import Page, write
from dfd.encoders.known import DEFAULT_ENCODER

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "paper"

# Every page: the module of `bench.paper` that has a function of its name, of a context, and what it shows.
PAGES: dict[str, tuple[str, str]] = {
    "fig4": ("features", "pixels that teach a field, and the field of a shape reduced by 99 %"),
    "fig5": ("controls", "planes of symmetry that are seen, and edits of one side"),
    "fig6": ("controls", "feature space constraints: what looks like a fixed point stays"),
    "fig7": ("controls", "locality: one deformation, less and less of the shape"),
    "fig8": ("comparisons", "one handle translated, with its weights, beside methods that need fixed points"),
    "fig9": ("comparisons", "layouts of DeepMetaHandles by every method (Fig. 16 too)"),
    "fig10": ("resolution", "seconds of every method to preprocess, bind and pose over the number of faces"),
    "fig11": ("encoders", "one deformation with the features of several image encoders"),
    "fig12": ("encoders", "weights of several image encoders"),
    "fig13": ("features", "barycentric distillation against vertices alone, from coarse to fine"),
    "fig14": ("comparisons", "one handle by every method, others with the neighbors of their constraints"),
    "fig15": ("comparisons", "the same without neighbors"),
    "fig17": ("resolution", "shapes with holes, loose components and non-manifold edges"),
    "fig18": ("resolution", "large meshes: defects, holes, and seconds of each stage"),
    "fig19": ("features", "one field on other tessellations and on another animal"),
    "fig20": ("features", "the same parts on different shapes of one class"),
    "fig21": ("comparisons", "DFD with fifty handles"),
    "fig22": ("comparisons", "what every method does to the surface, in numbers"),
    "table3": ("resolution", "seconds to bind 1, 10 and 100 new handles, beside OptCtrlPoints"),
    "study1": ("comparisons", "sheets of the first user study: the best two of anonymous options"),
    "study2": ("comparisons", "sheets of the second user study: the most realistic"),
    "handles": ("comparisons", "sets of handles as APAP-Bench 3D and DeepMetaHandles have them, by every method"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Make one page, or list them; 1 if some shape of the page could not be read."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.list:
        for name, (_, shows) in PAGES.items():
            print(f"{name:8} {shows}")
        return 0
    if options.name is None:
        parser.error("NAME must be one of " + ", ".join(PAGES))
    console = Console(stderr=True, highlight=False)
    folder = options.meshes or options.folder
    if folder is not None and not folder.is_dir():
        parser.error(f"{folder} is not a folder")
    context = Context(
        folder=folder,
        quick=options.quick,
        encoder=options.encoder,
        ball=options.ball,
        say=lambda line: console.print(line, markup=False, soft_wrap=True),
    )
    try:
        page = make(options.name, context)
    except (ValueError, OSError) as error:
        parser.error(str(error))
    settings = {"quick": context.quick, "presets": context.used}
    path = write(page, options.name, options.output, context.notes(), settings)
    Console().print(f"{path}", highlight=False, soft_wrap=True)
    return 1 if page.failed else 0


def make(name: str, context: Context) -> Page:
    """The page called `name`; ValueError or OSError if it cannot be made."""
    return getattr(import_module(f"bench.paper.{PAGES[name][0]}"), name)(context)


def _radius(text: str) -> float:
    value = float(text)
    if not 0 <= value < 1:
        raise ValueError
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bench.paper", description=__doc__)
    parser.add_argument("name", metavar="NAME", nargs="?", choices=PAGES, help="of the page, see --list")
    parser.add_argument("folder", metavar="FOLDER", nargs="?", type=Path, help="the same as --meshes FOLDER")
    parser.add_argument("--list", action="store_true", help="list the pages and stop")
    parser.add_argument("--meshes", type=Path, help="folder whose meshes are shown; else those that DFD_MESHES has")
    parser.add_argument("--quick", action="store_true", help="fewer and smaller pictures, fewer shapes")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    parser.add_argument("--encoder", default=DEFAULT_ENCODER, help="of all fields (%(default)s)")
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
