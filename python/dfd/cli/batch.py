"""The command `dfd batch`: process many shapes in parallel."""

from __future__ import annotations

import json
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from dfd.cli import options
from dfd.cli.arguments import preset_of
from dfd.cli.errors import say
from dfd.common import check
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.batch.one_edit import EditSource
    from dfd.batch.record import Record
    from dfd.common.preset import Preset

SOME_FAILED = 1  # exit code if a shape failed


def batch(
    inputs: Annotated[list[str], Argument(metavar="MESH…", help="Mesh files, patterns ('*.glb') or a CSV manifest.")],
    output: Annotated[Path, Option("--output", "-o", metavar="FOLDER", help="The folder to write.")],
    step: Annotated[
        list[str],
        Option(
            metavar="STEPS",
            help="inspect, distill, features, symmetry, parts, pictures, edits, exports; repeatable. If left out:"
            " inspect, distill, pictures, and with --edit also edits and exports.",
        ),
    ] = [],  # noqa: B006  # Typer copies it
    encoder: options.Encoder = DEFAULT_ENCODER,
    preset: options.PresetOfEdit = None,
    distill: Annotated[
        list[str] | None, Option(metavar="NAME=VALUE", help="A setting of `dfd distill`, such as views=12; repeatable.")
    ] = None,
    edit: Annotated[
        list[Path] | None, Option(metavar="JSON", help="An edit for all shapes; repeatable.", **options.READ)
    ] = None,
    made_on: Annotated[
        list[Path] | None,
        Option(
            metavar="MESH",
            help="The mesh on which each --edit was made. The mesh's folder must contain NAME.field.safetensors, the"
            " mesh's field. By default, the files that each edit names are used.",
        ),
    ] = None,
    threshold: Annotated[
        float | None, Option(min=0.0, max=1.0, help="Smallest confidence of a transferred edit; 0.5 if left out.")
    ] = None,
    export: Annotated[
        list[str] | None,
        Option(
            metavar="FORMATS",
            help="same (the format of the shape; the default), glb, obj, ply, stl, off; rig.glb; weights.npz,"
            " weights.safetensors; repeatable.",
        ),
    ] = None,
    workers: Annotated[
        int | None, Option(min=1, help="Shapes processed at a time; by default as many as processors and memory allow.")
    ] = None,
    threads: Annotated[int, Option(min=1, help="Threads for each shape.")] = 1,
    gpus: Annotated[float, Option(min=0.0, help="GPUs for each shape; with 0.25, four shapes share one GPU.")] = 0.0,
    timeout: Annotated[float | None, Option(metavar="SECONDS", help="Stop work on a shape after this time.")] = None,
    address: Annotated[
        str | None, Option(metavar="ADDRESS", help="Run on a Ray cluster: auto, HOST:PORT or ray://HOST:PORT.")
    ] = None,
    retry: Annotated[bool, Option("--retry", help="Also process shapes that failed before.")] = False,
) -> None:
    """Process many shapes, in parallel if Ray is installed. The same command resumes after an interruption.

    Each shape gets a folder of its own; shapes.jsonl and index.html list all shapes. On each shape, the handles of an
    --edit are put at the most similar places. A shape without similar places is refused.
    """
    if made_on and len(edit or ()) != len(made_on):
        raise ValueError("`--edit` and `--made-on` must be given equally often: each edit was made on a mesh")
    if workers is not None and address is not None:
        raise ValueError("`--workers` must not be given with `--address`: the cluster sets the number of workers")
    if timeout is not None:
        check.number(None, "--timeout", timeout, minimum=0.0, exclusive=True)

    from pydantic import ValidationError

    from dfd.batch.inputs import find_shapes
    from dfd.batch.page import tally
    from dfd.batch.record import CAUSES
    from dfd.batch.run import Resources, check_ray, run_batch
    from dfd.batch.settings import BatchSettings, begin_folder
    from dfd.common.progress import Stages

    shapes = find_shapes(inputs)
    steps = _listed(step) or ["inspect", "distill", "pictures", *(["edits", "exports"] if edit else [])]
    try:
        settings = BatchSettings(
            steps=tuple(steps),  # type: ignore[arg-type]  # `BatchSettings` checks them
            encoder=encoder,
            preset=preset,
            distill=_distill_settings(distill or [], preset_of(preset, *(edit or ())), "distill" in steps),
            device="cuda" if gpus else "cpu",
            edits=_edit_sources(edit or [], made_on or []),
            threshold=threshold,
            exports=tuple(_listed(export or [])) or (("same",) if "exports" in steps else ()),
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{first.get('ctx', {}).get('error', first['msg'])}") from None
    stages, resources = Stages(), Resources(address, workers, threads, gpus, timeout)
    check_ray(resources)  # raises an error before anything is written
    begin_folder(output, settings)
    try:
        with stages.stage("shapes", len(shapes)) as advance:

            def tell(record: Record) -> None:
                advance()
                if record.cause is not None:
                    say(f"{record.name} failed: {CAUSES[record.cause]}: {record.message}")
                for line in record.transfers():
                    say(f"{record.name}: {line}")

            records = run_batch(shapes, settings, output.absolute(), resources, retry=retry, tell=tell)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the same command resumes; finished shapes are in {output}") from None
    say(f"{output}: {tally(records)}, in {stages.seconds['shapes']:.1f} s")
    if any(record.status == "failed" for record in records):
        raise typer.Exit(SOME_FAILED)


def _edit_sources(edits: list[Path], made_on: list[Path]) -> tuple[EditSource, ...]:
    """Return the sources of the edits, and check that each edit can be read with its mesh and its field.

    Raises ValueError if an edit does not belong to its mesh, or two edits have the same name. Raises OSError if a file
    cannot be read.
    """
    from dfd.batch.one_edit import find_files

    sources = [find_files(edit, mesh) for edit, mesh in zip_longest(edits, made_on)]
    for source in sources:
        source.original()
        if [each.name for each in sources].count(source.name) > 1:
            raise ValueError(f"`--edit` must have distinct names, got {source.name} twice")
    return tuple(sources)


def _listed(texts: list[str]) -> list[str]:
    """Return all values of a repeatable option. Each of its `texts` may have several values, separated by commas."""
    return [part.strip() for text in texts for part in text.split(",") if part.strip()]


def _distill_settings(texts: list[str], preset: Preset, wanted: bool) -> dict[str, Any]:
    """Return all settings of the step distill. Each text, such as views=12, changes one setting of `preset`.

    Raises ValueError if a setting is unknown or out of its range, or if there are `texts` but the step is not `wanted`.
    """
    from dfd.distillation.settings import DistillSettings

    if texts and not wanted:
        raise ValueError("`--distill` settings need the step distill")
    known = DistillSettings.model_fields
    given: dict[str, Any] = {"preset": preset}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or name not in known:
            raise ValueError(f"`--distill` must be NAME=VALUE with one of {', '.join(sorted(known))}, got {text!r}")
        with suppress(ValueError):
            value = json.loads(value)
        given[name] = value
    return DistillSettings(**given).model_dump(mode="json") if wanted else {}
