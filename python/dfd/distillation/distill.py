"""Distill a field from a mesh, or load it from the user's cache."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import TYPE_CHECKING, Any

from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.field import cache as field_cache
from dfd.field.cache_key import cache_key

if TYPE_CHECKING:  # torch takes seconds to import, so it is imported only if no cached field is found
    from dfd.encoders.encode import Encoder
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh, MeshLike

# The end of a MemoryError's message, by stage: the data that fill the memory, and settings that reduce these data.
_PICTURES = "the pictures: lower `resolution` or `views`"
_FIT = "the fit: lower `batch`, `resolution` or `views`"
_ADVICE = dict.fromkeys(("load", "up", "simplify", "render"), _PICTURES)
_ADVICE["encode"] = "the tokens: lower `resolution` or `views`, or choose a smaller encoder"


def distill(
    mesh: MeshLike,
    encoder: str | PathLike[str] | Encoder = DEFAULT_ENCODER,
    *,
    preset: Preset = "default",
    views: int | None = None,
    resolution: int | None = None,
    up: str | tuple[float, float, float] | None = None,
    smoothing: float | None = None,
    steps: int | None = None,
    epochs: int | None = None,
    seed: int | None = None,
    device: str | None = None,
    progress: bool | Stages = True,
    cache: bool = True,
    **settings: Any,
) -> Field:
    """Distill the features of an image encoder into a field around `mesh`.

    Raises ValueError if an argument is out of range, the encoder is unknown, or no camera ray hits the mesh. Raises
    ValueError if a loaded encoder contradicts `block` or `background`. Raises OSError if the encoder's weights cannot
    be found or read. Raises MemoryError if memory runs out; the message names the settings to lower.

    Source: paper, Eq. 2 and 3 and supplement L.

    Parameters
    ----------
    mesh
        A mesh, or anything that `dfd.load` accepts. Textures, holes, several components and degenerate faces are
        allowed.
    encoder
        A known encoder's name, a folder with weights, a hub name, or a loaded encoder.
    preset
        The source of all settings that are not given: "default", or "paper" for the procedure of the paper.
    views, resolution
        The number of pictures, and the side of a picture in pixels.
    up
        The up direction: an axis such as "+y" or "-z", a direction (3,), "file" for the file's +y, or "auto" to find
        it from pictures.
    smoothing
        Distance of smoothing along the surface, divided by half the longest side of the upright shape's bounding box.
    steps, epochs
        Length of the fit: `steps` counts batches, `epochs` counts passes over all points. Give only one of them.
    seed
        Seed of all random numbers. Calls with equal seeds and thread counts give equal fields on one machine. On
        another machine, features differ by about 1e-3.
    device
        Torch device, such as "cpu" or "cuda"; None takes CUDA if available. The device also decides the encoder's
        precision, "float32" or "bfloat16" (see `load_encoder`). A loaded encoder keeps its own device and precision.
    progress
        True shows progress bars on standard error; a `Stages` also records the duration of each stage.
    cache
        Whether to use the user's cache (see `dfd.common.files.cache_directory`): a field in the cache is loaded, and a
        new field is stored there.
    settings
        Any other setting of `DistillSettings`.

    Returns
    -------
    Field. `field.settings` holds all settings, the encoder's block and precision, the side of the encoded pictures
    in pixels ("encoded_resolution"), whether background patches were encoded, and the loss of every step.
    "up_direction" and "up_confidence" describe the up direction. If `up` is "auto", "up_source" is "file" for the
    file's +y, "found" for another direction, or "averaged" if the features of two directions are combined.
    Otherwise, "up_source" is "said".

    Warns
    -----
    RuntimeWarning
        If the cache cannot be written; the call continues.

    Examples
    --------
    >>> import dfd
    >>> mesh = dfd.samples.chair().mesh
    >>> field = dfd.distill(mesh)
    >>> field.save("chair.field.safetensors")
    >>> field = dfd.Field.load("chair.field.safetensors", mesh=mesh)
    >>> field.settings["views"]
    24
    """
    from dfd.mesh.mesh import as_mesh

    main: dict[str, Any] = {"views": views, "resolution": resolution, "up": up, "smoothing": smoothing}
    main |= {"steps": steps, "epochs": epochs, "seed": seed}
    given = {name: value for name, value in main.items() if value is not None}
    mesh, checked = as_mesh(mesh), DistillSettings(preset=preset, **given, **settings)
    stages = progress if isinstance(progress, Stages) else Stages(show=bool(progress))
    with stages.stage("load"):
        known = _find_key(mesh, encoder, checked, device)
        found = field_cache.find(known) if cache and known else None
        if found is None:
            key, run = _prepare(mesh, encoder, checked, device)
            if cache and key != known:
                found = field_cache.find(key)
    if found is not None:
        return found
    try:
        field = run(stages).with_surface(mesh)
    except (MemoryError, RuntimeError) as error:
        from dfd.common.devices import out_of_memory

        if not out_of_memory(error) or str(error).startswith("encode: "):
            raise
        raise MemoryError(f"distill: too little memory for {_ADVICE.get(stages.latest or '', _FIT)}") from error
    if cache:
        field_cache.store(key, field)
    return field


def find_distilled(
    mesh: Mesh, encoder: str | PathLike[str] | Encoder, settings: DistillSettings, *, device: str | None = None
) -> Field | None:
    """Return the field for these arguments from the user's cache, or None if there is none; no encoder is loaded."""
    key = _find_key(mesh, encoder, settings, device)
    return field_cache.find(key) if key else None


def store_distilled(
    field: Field, mesh: Mesh, encoder: str | PathLike[str], settings: DistillSettings, *, device: str | None = None
) -> None:
    """Store `field`, which a loaded encoder gave for these arguments, where `find_distilled` finds it."""
    if key := _find_key(mesh, encoder, settings, device):
        field_cache.store(key, field)


def _find_key(
    mesh: Mesh, encoder: str | PathLike[str] | Encoder, settings: DistillSettings, device: str | None
) -> dict[str, Any] | None:
    """Return the cache key without loading the encoder; None if the encoder's weights are not on this machine."""
    from dfd.encoders.sources import find_identity

    if isinstance(encoder, str | PathLike):
        identity = find_identity(encoder, device)
    elif hasattr(encoder, "identity"):
        identity = encoder.identity()
    else:
        raise ValueError(f"distill: `encoder` must be a name, a folder or a loaded Encoder, got {encoder!r}")
    return cache_key(mesh, **settings.as_dict(), **identity) if identity else None


def _prepare(
    mesh: Mesh, encoder: str | PathLike[str] | Encoder, settings: DistillSettings, device: str | None
) -> tuple[dict[str, Any], Callable[[Stages], Field]]:
    """Load the encoder, and return the cache key and the function that computes the field."""
    from dfd.distillation.algorithm import distill_pictures
    from dfd.encoders.encode import Encoder, load_encoder
    from dfd.encoders.sources import IDENTITY

    if isinstance(encoder, Encoder):
        if settings.block not in (None, encoder.block):
            found = f"{encoder.block}, got {settings.block}"
            raise ValueError(f"distill: `block` must be that of the loaded encoder, {found}")
        if settings.background and encoder.foreground_only:
            remedy = "load it with background=True, or give its name"
            raise ValueError(f"distill: `background` must be False for this loaded encoder, got True: {remedy}")
        model, identity = encoder, encoder.identity()
    else:
        model = load_encoder(encoder, device=device, **settings.of_encoder())
        identity = {name: model.identity()[name] for name in IDENTITY}  # equals the result of `find_identity`
    key = cache_key(mesh, **settings.as_dict(), **identity)
    return key, lambda stages: distill_pictures(mesh, model, settings, stages=stages)
