"""`dfd distill`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import dfd
from dfd.cli.arguments import MeshArgument, check_output
from dfd.common.importing import importing
from dfd.common.progress import Stages
from dfd.distillation.distill import DEFAULT_ENCODER, distilling, find_distilled
from dfd.distillation.settings import DistillSettings
from dfd.field.given_features import read_features, rows_of_vertices
from dfd.runs.known_meshes import hash_file, note, recall

if TYPE_CHECKING:
    from dfd.field.field import Field

__all__ = ["distill"]

DEFAULTS = DistillSettings()
FEATURES = "`--features`"


def distill(
    context: typer.Context,
    mesh: MeshArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FIELD", help="The .safetensors file to write.")],
    encoder: Annotated[
        str, typer.Option(metavar="NAME", help="A preset's name, a folder with weights, or a hub name.")
    ] = DEFAULT_ENCODER,
    views: Annotated[int, typer.Option(help="Pictures taken from around the shape.")] = DEFAULTS.views,
    resolution: Annotated[int, typer.Option(help="Pixels along a picture's side.")] = DEFAULTS.resolution,
    framing: Annotated[
        str, typer.Option(help="shape: it fills every picture; paper: cameras at a distance of 2.8.")
    ] = DEFAULTS.framing,
    simplify_to: Annotated[
        int | None, typer.Option(metavar="FACES", help="Take the pictures of a copy of at most so many faces.")
    ] = DEFAULTS.simplify_to,
    up: Annotated[
        str, typer.Option(metavar="DIRECTION", help="Which way is up: auto, file, +y, -z, …, or numbers such as 0,0,1.")
    ] = DEFAULTS.up,  # type: ignore[assignment]
    supervision: Annotated[
        str, typer.Option(help="barycentric: fit every pixel; vertex: only those that hold a vertex.")
    ] = DEFAULTS.supervision,
    mirrored: Annotated[
        bool, typer.Option("--mirrored/--not-mirrored", help="Take the pictures in fours that mirror each other.")
    ] = DEFAULTS.mirrored,
    smoothing: Annotated[
        float, typer.Option(help="How far features spread along the surface before the fit; 0 is the paper's loss.")
    ] = DEFAULTS.smoothing,
    metric: Annotated[
        str, typer.Option(help="learned: distances that tell parts apart, where there are some; none: the paper's.")
    ] = DEFAULTS.metric,
    octaves: Annotated[
        int, typer.Option(help="Wavelengths of the sines that the field is given; 0 is the paper's network.")
    ] = DEFAULTS.octaves,
    steps: Annotated[int, typer.Option(help="Length of the fit.")] = DEFAULTS.steps,
    batch: Annotated[int, typer.Option(help="Surface points in each step of the fit.")] = DEFAULTS.batch,
    learning_rate: Annotated[float, typer.Option(help="Peak of the fit's one-cycle rate.")] = DEFAULTS.learning_rate,
    seed: Annotated[int, typer.Option(help="Equal seeds give equal fields.")] = DEFAULTS.seed,
    device: Annotated[
        str | None, typer.Option(help="Where torch computes: cpu, cuda, …; by default CUDA when there is one.")
    ] = None,
    features: Annotated[
        Path | None,
        typer.Option(metavar="NPY|PT", help="Fit these instead: another network's, a row for each vertex or face."),
    ] = None,
    cache: Annotated[
        bool, typer.Option("--cache/--no-cache", help="Take it from the cache when it was made before.")
    ] = True,
    loss_curve: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw the loss of every step.")] = None,
) -> None:
    """Distill an image encoder's features into a field around MESH. Needed once per shape.

    What is done is kept in a folder beside FIELD until FIELD is whole: the same command goes on from there.
    """
    check_output("--output", output, (".safetensors",))
    check_output("--loss-curve", loss_curve, (".png",))

    # The parameters above are what Typer makes options of; their values are also in its context.
    settings = DistillSettings(**{each.name: context.params[each.name] for each in dataclasses.fields(DistillSettings)})
    rows = None if features is None else read_features(features, FEATURES)
    partial = output.with_name(f"{output.name}.partial")
    stages = Stages()
    found: Field | None = None
    with stages.stage("read"), importing():
        file = hash_file(mesh) if cache else None
        known = recall(file)
        look_up = cache and rows is None
        if known is not None and look_up:
            found = find_distilled(known, encoder, settings, device=device, checkpoint=partial)
        if found is None:
            from dfd.encoders.ahead import load_ahead

            loading = load_ahead(encoder, device=device) if rows is None else None
            shape = dfd.load(mesh)
            if features is not None and rows is not None:
                rows = rows_of_vertices(features, rows, shape, FEATURES)
            if file == hash_file(mesh):  # the file that was read, and no later one
                note(file, shape)
            if look_up:
                found = find_distilled(shape, encoder, settings, device=device, checkpoint=partial)
    if found is not None:
        field = found
        field.save(output)
    else:
        try:
            with distilling(
                shape,
                encoder,
                settings,
                features=rows,
                device=device,
                stages=stages,
                cache=cache,
                checkpoint=partial,
                loading=loading,
            ) as field:
                field.save(output)
        except KeyboardInterrupt:
            if partial.exists():
                message = f"the same command goes on from here; what is done is in {partial}"
                raise KeyboardInterrupt(message) from None
            raise
    if loss_curve is not None:
        from dfd.pictures.loss_curve import save_loss_curve

        save_loss_curve(loss_curve, field.settings["losses"])
    times = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in stages.seconds.items())
    origin = ", from the cache" if found else ""
    from dfd.distillation.up import up_sentence

    if up := up_sentence(field.settings):
        typer.echo(f"up: {up}", err=True)
    typer.echo(f"{output}: a field of {field.dimension} dimensions{origin} ({times})", err=True)
