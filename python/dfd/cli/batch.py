"""`dfd batch`."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from dfd.cli.arguments import EncoderOption, ThresholdOption
from dfd.common import check
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.batch.pool import Slots
    from dfd.batch.record import Limits

GIB = 2**30
SOME_FAILED = 1  # exit code
LARGE = 1000  # shapes; more of them have folders in folders


def batch(
    inputs: Annotated[
        list[str], Argument(metavar="MESH…", help="Meshes, 'globs', or one manifest (.csv, .parquet); or URLs.")
    ],
    output: Annotated[Path, Option("--output", "-o", metavar="FOLDER", help="Where everything goes.")],
    step: Annotated[
        list[str],
        Option(
            metavar="STEPS", help="inspect, distill, features, symmetry, parts, pictures, edits, exports; repeatable."
        ),
    ] = ["inspect", "distill", "pictures"],  # noqa: B006  # Typer copies it
    encoder: EncoderOption = DEFAULT_ENCODER,
    preset: Annotated[str | None, Option(metavar="default|paper", help="How fields are distilled, not edits.")] = None,
    distill: Annotated[
        list[str] | None, Option(metavar="NAME=VALUE", help="A setting of `dfd distill`, such as views=12; repeatable.")
    ] = None,
    edit: Annotated[list[Path] | None, Option(metavar="JSON", help="An edit for every shape; repeatable.")] = None,
    made_on: Annotated[
        list[Path] | None,
        Option(
            metavar="MESH",
            help="What each --edit was made on, with its field NAME.field.safetensors beside; where left"
            " out, what the edits say.",
        ),
    ] = None,
    threshold: ThresholdOption = None,
    export: Annotated[
        list[str] | None,
        Option(
            metavar="FORMATS",
            help="glb, obj, ply, stl, off; rig.glb, rig.usdc, rig.usdz; weights.npz, weights.safetensors; repeatable.",
        ),
    ] = None,
    workers: Annotated[
        int | None, Option(min=1, help="Shapes at a time; by default as many as processors and memory allow.")
    ] = None,
    threads: Annotated[int, Option(min=1, help="Threads of each.")] = 1,
    gpus: Annotated[float, Option(min=0.0, help="GPUs of each; 0.25 puts four on one, 0 computes without.")] = 0.0,
    memory: Annotated[
        float | None, Option(metavar="GIB", help="Memory of each; more ends it. By default 2.5, 1.5 to look only.")
    ] = None,
    timeout: Annotated[float | None, Option(metavar="SECONDS", help="Give up a shape that takes longer.")] = None,
    rank: Annotated[int, Option(min=0, help="With --world-size: which part of the shapes is mine.")] = 0,
    world_size: Annotated[int, Option(min=1, help="Into how many parts the shapes are divided.")] = 1,
    ray: Annotated[bool, Option("--ray", help="Run on Ray, started on this machine.")] = False,
    ray_address: Annotated[
        str | None, Option(metavar="ADDRESS", help="Run on the Ray cluster there: auto, HOST:PORT, ray://…")
    ] = None,
    retry: Annotated[bool, Option("--retry", help="Do anew what failed before.")] = False,
) -> None:
    """Work through a folder or a list of shapes, in parallel; the same command goes on where it was stopped.

    Each shape gets a folder of its own, and all together shapes.parquet and index.html.
    """
    if rank >= world_size:
        raise ValueError(f"`--rank` must be below `--world-size`, got {rank} of {world_size}")
    if made_on and len(edit or ()) != len(made_on):
        raise ValueError("`--edit` and `--made-on` must be given equally often: each edit was made on a mesh")
    if workers is not None and ray_address is not None:
        raise ValueError("`--workers` is for this machine: the cluster of `--ray-address` decides by itself")
    if timeout is not None:
        check.number(None, "--timeout", timeout, minimum=0.0, exclusive=True)
    try:
        import fsspec  # noqa: F401
        import psutil  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise ValueError(f"batches need more packages ({error.name}): pip install 'dfd[batch]'") from None
    from pydantic import ValidationError

    from dfd.batch.inputs import find_shapes
    from dfd.batch.pool import DISTILLING, LOOKING
    from dfd.batch.prepare import describe_edits, find_files, place_edits
    from dfd.batch.record import Limits, failures
    from dfd.batch.settings import BatchSettings

    shapes = find_shapes(inputs)
    originals: list[Path | None] = [*made_on] if made_on else [None] * len(edit or ())
    files = [find_files(*each) for each in zip(edit or (), originals, strict=True)]
    steps = _listed(step)
    sources = describe_edits(files)
    chosen = [*([] if preset is None else [f"preset={preset}"]), *(distill or [])]
    try:
        settings = BatchSettings(
            steps=tuple(steps),  # type: ignore[arg-type]  # checked there
            encoder=encoder,
            distill=_distill_settings(chosen, "distill" in steps),
            device="cuda" if gpus else "cpu",
            edits=sources,
            threshold=threshold,
            exports=tuple(_listed(export or [])),
            sharded=len(shapes) > LARGE,
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{first.get('ctx', {}).get('error', first['msg'])}") from None
    if any(each.startswith("rig.usd") for each in settings.exports):
        import_module("dfd.export.usd.export_usd")  # without its package it says so, before a shape is begun
    if memory is not None:
        check.number(None, "--memory", memory, minimum=0.0, exclusive=True)
    usual = DISTILLING if "distill" in settings.steps else LOOKING
    most = usual if memory is None else int(memory * GIB)
    limits = Limits(threads=threads, timeout=timeout, memory=most, gpus=gpus)
    slots = _slots(limits, workers, ray or ray_address is not None, ray_address)

    from dfd.batch.folder import BatchFolder
    from dfd.batch.run import BatchProgress, run_batch

    progress = BatchProgress()
    try:
        folder = BatchFolder.begin(output, settings)
        with folder.lock(rank, world_size), progress.shown():
            place_edits(folder, files, sources)
            summary = run_batch(
                shapes, settings, folder, slots, limits, progress, rank=rank, world_size=world_size, retry=retry
            )
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"the same command goes on from here; what is done is in {output}") from None
    finally:
        slots.close()
    told = "".join(f", {failures(cause, count)}" for cause, count in summary.causes.most_common())
    typer.echo(f"{output}: {summary.done} done{told}, in {summary.seconds:.1f} s", err=True)
    if summary.missing:
        typer.echo(f"{summary.missing} shapes of other ranks are missing; the last rank writes the table", err=True)
    if summary.failed:
        raise typer.Exit(SOME_FAILED)


def _slots(limits: Limits, workers: int | None, on_ray: bool, address: str | None) -> Slots:
    """Where the work is done."""
    if on_ray:
        from dfd.batch.on_ray import RaySlots, connect

        return RaySlots(connect(address, workers, limits.threads), limits)
    from dfd.batch.pool import ProcessSlots, slot_environments

    count = 0
    if limits.gpus:
        import torch

        count = torch.cuda.device_count()
    return ProcessSlots(slot_environments(workers, limits, count))


def _listed(texts: list[str]) -> list[str]:
    """Options that may be repeated or hold several, with commas between."""
    return [part.strip() for text in texts for part in text.split(",") if part.strip()]


def _distill_settings(texts: list[str], wanted: bool) -> dict[str, Any]:
    """The settings of the step distill, all of them, from texts such as views=12.

    Raises ValueError if one is unknown, no such text, or out of its range.
    """
    import json

    from dfd.distillation.settings import DistillSettings

    if not wanted:
        if texts:
            raise ValueError("`--distill` settings need the step distill")
        return {}
    known = DistillSettings.model_fields.keys()
    given: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or name not in known:
            raise ValueError(f"`--distill` must be NAME=VALUE with one of {', '.join(sorted(known))}, got {text!r}")
        try:
            given[name] = json.loads(value)
        except ValueError:
            given[name] = value
    return dict(json.loads(json.dumps(DistillSettings(**given).as_dict())))
