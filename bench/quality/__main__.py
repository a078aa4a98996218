"""`python -m bench.quality`: tables and a page of pictures in bench/results/quality."""

from __future__ import annotations

import argparse
import ast
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console

import dfd
from bench.quality import labelled as labelled_bench
from bench.quality import shapes, sheet, studies
from bench.quality.evaluate import Draw
from bench.quality.fields import SETTINGS, Lab
from bench.quality.report import as_csv, as_markdown, timed
from bench.quality.shapes import Shape
from bench.quality.studies import Bench, Row, Settings
from bench.tables import write_text
from dfd.pictures.contact_sheet import contact_sheet
from dfd.pictures.picture import save_png

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "quality"
QUICK: Settings = {"views": 12, "resolution": 280}
QUICK_STUDIES = ("supervision", "textures", "background", "fit length")
UNTOLD = {"features", "seed", "device", "progress", "cache", "checkpoint"}  # no settings of a table's numbers
FEW_FACES, SOME_FACES, MANY_FACES = 4_000, 20_000, 100_000


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the studies that the command line asks for, or `bench.quality.labelled`."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    if given[:1] in (["labelled"], ["grip"]):
        labelled_bench.main(given)
        return
    parser = _parser()
    options = parser.parse_args(given)
    say = timed()
    if not options.download:
        os.environ["HF_HUB_OFFLINE"] = "1"  # encoders are those at hand; nobody wants gigabytes for a table
    try:
        settings = {**(QUICK if options.quick else {}), **settings_of(options.set)}
        variants = {text: settings_of([text]) for text in options.variant}
    except ValueError as error:
        parser.error(str(error))
    bench = Bench(
        Lab(settings, say),
        Draw(each=4, seeds=(0,)) if options.quick else Draw(),
        range(options.seeds or (1 if options.quick else 3)),
        say,
    )
    folder = Path(os.environ["DFD_MESHES"]) if os.environ.get("DFD_MESHES") else None
    if folder is None:
        say("DFD_MESHES is not set: made shapes only")
    labelled = shapes.made(FEW_FACES if options.quick else SOME_FACES)
    labelled += shapes.characters(folder, say) if folder else []
    animals = [*(shapes.rigs(folder, say) if folder else [])]
    rows: list[Row] = []
    plan = _plan(bench, labelled, folder, options.quick, variants)
    plan["families"] = partial(
        studies.families,
        bench,
        [*animals, *(shape for shape in labelled if "rig names" not in shape.name)],
        turns={} if options.as_they_come else studies.TURNS,
    )
    unknown = set(options.study) - plan.keys()
    if unknown:
        parser.error(f"--study must be one of {', '.join(plan)}; got {sorted(unknown)[0]}")
    chosen = [study for study in plan if not options.study or study in options.study]
    for study in chosen:
        say(f"[bold]{study}[/bold]")
        rows += plan[study]()
        _write(options.output, rows, bench, options.quick)
    if "methods" in chosen:
        say("[bold]pictures[/bold]")
        pages = [sheet.row(bench, shape) for shape in labelled]
        save_png(options.output / "quality.png", contact_sheet(pages, title="Best and worst part of each shape"))
    if "families" in chosen and animals:
        heading, pictures = sheet.worst(bench, animals)
        save_png(options.output / "worst.png", contact_sheet([("", pictures)], title=heading))
    say("done")
    Console().print(f"{options.output / 'quality.md'}", highlight=False, soft_wrap=True)


def settings_of(texts: Sequence[str]) -> dict[str, Any]:
    """Settings from words such as "steps=300": Python literals, and plain words for the rest.

    Raises ValueError if a word has another form, or names no setting of the lab's.
    """
    settings: dict[str, Any] = {}
    for word in " ".join(texts).split():
        name, equals, value = word.partition("=")
        if not equals:
            raise ValueError(f"a setting must read name=value, got {word!r}")
        if name not in SETTINGS:
            raise ValueError(f"there is no setting {name!r}")
        try:
            settings[name] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            settings[name] = value
    return settings


def _plan(
    bench: Bench, labelled: list[Shape], folder: Path | None, quick: bool, variants: dict[str, Settings]
) -> dict[str, Callable[[], list[Row]]]:
    """The studies by name, in order."""
    spot = None if quick else shapes.unlabelled(folder, "spot.obj")
    last = labelled[-1].mesh  # the character without what it carries, or the robot: under all its names
    subjects = [shape for shape in labelled if shape.mesh is last]
    subjects = subjects if quick else [labelled[1], *subjects, *([spot] if spot else [])]
    everything = [*labelled, *([spot] if spot else [])]
    colored = [shape for shape in (subjects if quick else labelled) if shape.mesh.appearance is not None]
    plan: dict[str, Callable[[], list[Row]]] = {"methods": lambda: studies.methods(bench, everything, peers=not quick)}
    if variants:
        plan["variants"] = partial(studies.compare, bench, "variants", everything, {"default": {}, **variants})

    def compare(study: str) -> list[Row]:
        on = {"textures": colored, "casting": [_detailed(folder)] if study == "casting" else []}.get(study, subjects)
        return studies.compare(bench, study, on, studies.COMPARED[study](bench.lab))

    for study in QUICK_STUDIES if quick else studies.COMPARED:
        if study != "textures" or colored:
            plan[study] = partial(compare, study)
    return plan


def _detailed(folder: Path | None) -> Shape:
    """A shape of a hundred thousand faces."""
    found = shapes.unlabelled(folder, "koala.obj")
    if found is not None:
        return found
    sample = dfd.samples.quadruped(MANY_FACES)
    return Shape(f"quadruped, {len(sample.mesh.faces):,} faces", sample.mesh, sample.labels, sample.parts)


def _write(output: Path, rows: Sequence[Row], bench: Bench, quick: bool) -> None:
    """Whole files, after every study: a long run that is cut short has told what it knew."""
    told = (f"{name} {value}" for name, value in bench.lab.settings.items() if name not in UNTOLD)
    seeds = f"{len(bench.seeds)} seeds of the fit" if len(bench.seeds) > 1 else "one seed of the fit"
    drawn = f"{bench.draw.each} handles in every part, drawn {len(bench.draw.seeds)} times"
    heading = f"{'A quick look. ' if quick else ''}Settings: {', '.join(told)}; {seeds}; {drawn}."
    if bench.lab.settings["metric"] == "learned":
        heading += " The metric was learned from rigs and samples; `bench.training.learn_metric` leaves families out."
    output.mkdir(parents=True, exist_ok=True)
    told_by_family = studies.by_family(rows) if any(row.study == studies.FAMILIES_STUDY for row in rows) else ""
    write_text(output / "quality.csv", as_csv(rows))
    write_text(output / "quality.md", as_markdown(rows, heading) + told_by_family)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bench.quality", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="smaller pictures, fewer handles, one seed: a minute")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    parser.add_argument("--study", action="append", default=[], help="only this study; may be repeated")
    parser.add_argument("--seeds", type=int, help="fits that each number is the mean of")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a setting of all fields")
    parser.add_argument(
        "--variant",
        action="append",
        default=[],
        metavar="'NAME=VALUE …'",
        help="settings to compare with the default on every shape; may be repeated",
    )
    parser.add_argument(
        "--as-they-come", action="store_true", help="families without turned copies, which take eight times as long"
    )
    parser.add_argument("--download", action="store_true", help="fetch the weights of all known encoders from the hub")
    return parser


if __name__ == "__main__":
    main()
