"""`dfd distill`."""

from __future__ import annotations

from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import dfd
from dfd.cli.arguments import MeshArgument, check_output
from dfd.common.progress import Stages
from dfd.distillation.distill import find_distilled
from dfd.runs.known_meshes import file_digest, note, recall

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["distill"]

# Defaults have one home, the signature of the function that this command is the front of.
DEFAULTS = {name: parameter.default for name, parameter in signature(dfd.distill).parameters.items()}


def distill(
    mesh: MeshArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FIELD", help="The .safetensors file to write.")],
    encoder: Annotated[
        str, typer.Option(metavar="NAME", help="A preset's name, a folder with weights, or a hub name.")
    ] = DEFAULTS["encoder"],
    views: Annotated[int, typer.Option(help="Pictures taken from around the shape.")] = DEFAULTS["views"],
    resolution: Annotated[int, typer.Option(help="Pixels along a picture's side.")] = DEFAULTS["resolution"],
    framing: Annotated[
        str, typer.Option(help="shape: it fills every picture; paper: cameras at a distance of 2.8.")
    ] = DEFAULTS["framing"],
    simplify_to: Annotated[
        int | None, typer.Option(metavar="FACES", help="Take the pictures of a copy of at most so many faces.")
    ] = DEFAULTS["simplify_to"],
    supervision: Annotated[
        str, typer.Option(help="barycentric: fit every pixel; vertex: only those that hold a vertex.")
    ] = DEFAULTS["supervision"],
    mirrored: Annotated[
        bool, typer.Option("--mirrored/--not-mirrored", help="Take the pictures in fours that mirror each other.")
    ] = DEFAULTS["mirrored"],
    smoothing: Annotated[
        float, typer.Option(help="How far features spread along the surface before the fit; 0 is the paper's loss.")
    ] = DEFAULTS["smoothing"],
    octaves: Annotated[
        int, typer.Option(help="Wavelengths of the sines that the field is given; 0 is the paper's network.")
    ] = DEFAULTS["octaves"],
    steps: Annotated[int, typer.Option(help="Length of the fit.")] = DEFAULTS["steps"],
    batch: Annotated[int, typer.Option(help="Surface points in each step of the fit.")] = DEFAULTS["batch"],
    learning_rate: Annotated[float, typer.Option(help="Peak of the fit's one-cycle rate.")] = DEFAULTS["learning_rate"],
    seed: Annotated[int, typer.Option(help="Equal seeds give equal fields.")] = DEFAULTS["seed"],
    device: Annotated[
        str | None, typer.Option(help="Where torch computes: cpu, cuda, …; by default CUDA when there is one.")
    ] = DEFAULTS["device"],
    features: Annotated[
        Path | None,
        typer.Option(metavar="NPY", help="Fit these instead: another network's features, a row for each vertex."),
    ] = DEFAULTS["features"],
    cache: Annotated[
        bool, typer.Option("--cache/--no-cache", help="Take it from the cache when it was made before.")
    ] = DEFAULTS["cache"],
    loss_curve: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw the loss of every step.")] = None,
) -> None:
    """Distill an image encoder's features into a field around MESH. Needed once per shape.

    What is done is kept in a folder beside FIELD until FIELD is whole: the same command goes on from there.
    """
    check_output("--output", output, (".safetensors",))
    check_output("--loss-curve", loss_curve, (".png",))

    partial = output.with_name(f"{output.name}.partial")
    options: dict[str, Any] = {
        "views": views,
        "resolution": resolution,
        "framing": framing,
        "simplify_to": simplify_to,
        "supervision": supervision,
        "mirrored": mirrored,
        "smoothing": smoothing,
        "octaves": octaves,
        "steps": steps,
        "batch": batch,
        "learning_rate": learning_rate,
        "seed": seed,
        "device": device,
        "features": None if features is None else _read_features(features),
        "cache": cache,
        "checkpoint": partial,
    }
    stages = Stages()
    with stages.stage("read"):
        file = file_digest(mesh) if cache else None
        known = recall(file)
        cached = find_distilled(known, encoder, **options) if known else None
        if cached is None:
            shape = dfd.load(mesh)
            cached = find_distilled(shape, encoder, **options)
            if file == file_digest(mesh):  # the file that was read, and no later one
                note(file, shape)
    try:
        field = cached or dfd.distill(shape, encoder, **options, progress=stages)
    except KeyboardInterrupt:
        if partial.exists():
            raise KeyboardInterrupt(f"the same command goes on from here; what is done is in {partial}") from None
        raise
    field.save(output)
    if loss_curve is not None:
        from dfd.pictures.loss_curve import save_loss_curve

        save_loss_curve(loss_curve, field.settings["losses"])
    times = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in stages.seconds.items())
    origin = ", from the cache" if cached else ""
    typer.echo(f"{output}: a field of {field.dimension} dimensions{origin} ({times})", err=True)


def _read_features(path: Path) -> NDArray[Any]:
    """The array in an `.npy` file.

    Raises
    ------
    ValueError
        If it is no such file, or cut short, or holds Python objects, which are never opened.
    OSError
        If it cannot be read.
    """
    import numpy as np

    try:
        with path.open("rb") as stream:
            return np.lib.format.read_array(stream, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise ValueError(f"`--features` must be an .npy file of numbers, but {path} is not: {error}") from None
