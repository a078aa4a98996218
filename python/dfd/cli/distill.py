"""`dfd distill`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin

import typer
from typer import Option

import dfd
from dfd.cli.arguments import EncoderOption, MeshArgument, add_options, check_output, shown
from dfd.common.interrupts import importing
from dfd.common.progress import Stages
from dfd.distillation.distill import distilling, find_distilled
from dfd.distillation.settings import DistillSettings
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.field.cache import hash_file, note, recall
from dfd.field.given_features import read_features, rows_of_vertices

if TYPE_CHECKING:
    from dfd.field.field import Field

FEATURES = "`--features`"


def _option(name: str) -> Any:
    """The option of a setting: its type as a word of the command line, its description and what it is by itself."""
    field = DistillSettings.model_fields[name]
    kinds = [kind for kind in get_args(field.annotation) or (field.annotation,) if kind is not type(None)]
    kind = kinds[0] if kinds[0] in (bool, int, float) else str
    default, paper = (shown(getattr(DistillSettings(preset=preset), name)) for preset in ("default", "paper"))
    by_itself = default if default == paper or name == "preset" else f"{default}; paper: {paper}"
    choices = "|".join(get_args(field.annotation)) if get_origin(field.annotation) is Literal else None
    return Annotated[kind | None, Option(metavar=choices, help=field.description, show_default=by_itself)]


@lambda command: add_options(command, {name: _option(name) for name in DistillSettings.model_fields})
def distill(
    mesh: MeshArgument,
    output: Annotated[Path, Option("--output", "-o", metavar="FIELD", help="The .safetensors file to write.")],
    encoder: EncoderOption = DEFAULT_ENCODER,
    device: Annotated[str | None, Option(help="Where torch computes: cpu, cuda, …; CUDA if there is one.")] = None,
    features: Annotated[
        Path | None,
        Option(metavar="NPY|PT", help="Fit these instead: another network's, a row for each vertex or face."),
    ] = None,
    cache: Annotated[bool, Option("--cache/--no-cache", help="Take it from the cache when it was made before.")] = True,
    loss_curve: Annotated[Path | None, Option(metavar="PNG", help="Draw the loss of every step.")] = None,
    **settings_given: Any,
) -> None:
    """Distill an image encoder's features into a field around MESH. Needed once per shape.

    What the encoder saw is kept in a folder beside FIELD until FIELD is whole: the same command, if it was stopped,
    resumes at the next picture.
    """
    check_output("--output", output, (".safetensors",))
    check_output("--loss-curve", loss_curve, (".png",))

    settings = DistillSettings(**{name: value for name, value in settings_given.items() if value is not None})
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
            from dfd.encoders.loading import load_in_background

            options = settings.of_encoder()
            loading = load_in_background(encoder, device=device, **options) if rows is None else None
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
    from dfd.upright.candidates import up_sentence

    if up := up_sentence(field.settings):
        typer.echo(f"up: {up}", err=True)
    typer.echo(f"{output}: a field of {field.dimension} dimensions{origin} ({times})", err=True)
