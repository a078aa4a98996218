"""The command `dfd distill`: distill the features of an image encoder into a field of a mesh."""

from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from typer import Option

import dfd
from dfd.cli import options
from dfd.cli.arguments import check_output, open_mesh
from dfd.cli.errors import say
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.upright.candidates import up_sentence


def distill(
    mesh: options.Mesh,
    output: Annotated[Path, Option("--output", "-o", metavar="FIELD", help="The .safetensors file to write.")],
    encoder: options.Encoder = DEFAULT_ENCODER,
    device: Annotated[str | None, Option(help="Device of torch: cpu, cuda, …; by default CUDA if available.")] = None,
    cache: Annotated[bool, Option("--cache/--no-cache", help="Use the cached field if it exists.")] = True,
    **settings_given: Any,
) -> None:
    """Distill the features of an image encoder into a field of MESH. Do this once per shape."""
    check_output("--output", output, (".safetensors",))

    given = {name: value for name, value in settings_given.items() if value is not None}
    DistillSettings(**given)  # raises an error before the mesh is read
    stages = Stages()
    shape = open_mesh(mesh, stages)
    field = dfd.distill(shape, encoder, device=device, progress=stages, cache=cache, **given)
    field.save(output)
    origin = "" if "fit" in stages.seconds else ", from the cache"
    if up := up_sentence(field.settings):
        say(f"up: {up}")
    say(f"{output}: a field of {field.dimension} dimensions{origin} ({stages})")


def _option(name: str) -> Any:
    """Return the annotation of the option for the setting `name`: type, description and default values."""
    field = DistillSettings.model_fields[name]
    kinds = [kind for kind in get_args(field.annotation) or (field.annotation,) if kind is not type(None)]
    kind = kinds[0] if kinds[0] in (bool, int, float) else str
    values = [getattr(DistillSettings(preset=preset), name) for preset in ("default", "paper")]
    said = options.by_preset(*values[: 1 if name == "preset" else 2])
    choices = "|".join(get_args(field.annotation)) if get_origin(field.annotation) is Literal else None
    return Annotated[kind | None, Option(metavar=choices, help=field.description, show_default=said)]


options.add_options(distill, {name: _option(name) for name in DistillSettings.model_fields}, after="cache")
