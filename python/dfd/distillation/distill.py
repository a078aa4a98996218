"""From a mesh to its feature field: render, encode, fit (paper, sections 3.1 and 3.2)."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from inspect import signature
from os import PathLike
from typing import TYPE_CHECKING, Any

from dfd.common import check
from dfd.common.progress import Stages

# torch and transformers take seconds to import; they wait until something is distilled.
if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from dfd.encoders.encode import Encoder
    from dfd.field.field import Field
    from dfd.mesh.mesh import MeshLike
    from dfd.runs.field_cache import CachedField
    from dfd.runs.recipe import Content
    from dfd.runs.run import Run

__all__ = ["distill", "find_distilled"]


def distill(
    mesh: MeshLike,
    encoder: str | PathLike[str] | Encoder = "dinov2-small",
    *,
    features: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    views: int = 24,
    resolution: int = 518,
    framing: str = "shape",
    simplify_to: int | None = None,
    supervision: str = "barycentric",
    mirrored: bool = True,
    smoothing: float = 0.3,
    octaves: int = 5,
    steps: int = 1000,
    batch: int = 192,
    learning_rate: float = 2e-2,
    seed: int = 0,
    device: str | None = None,
    progress: bool | Stages = True,
    cache: bool = True,
    checkpoint: str | PathLike[str] | None = None,
) -> Field:
    """Distil the features of an image encoder, or features that are given, into a field around `mesh`.

    Parameters
    ----------
    mesh
        The shape, or whatever `dfd.load` makes one of; with or without textures, holes, loose parts and faces of no
        area.
    encoder
        A preset's name, a folder with weights, a hub name, or an encoder that is loaded already.
    features
        Features of another network, which are fitted instead of an encoder's: (V, D), a row a vertex, or the pair
        points (N, 3) in mesh units and their rows (N, D). What concerns pictures has no meaning then.
    views, resolution
        How many pictures are taken from around the shape, and the pixels along a side of each.
    framing
        "shape": every view is filled by the shape; "paper": the cameras of the paper, at a distance of 2.8.
    simplify_to
        Take the pictures of a copy of at most so many faces, as the paper does above 50,000; None casts rays at the
        mesh itself, as fast below half a million faces and faster above.
    supervision
        "barycentric" fits every covered pixel (Eq. 2); "vertex" only pixels that hold a vertex, the paper's ablation.
    mirrored
        Take the views in fours that are each other's mirror images at the upright middle planes, pictures included: the
        encoder's own sense of left and right evens out.
    smoothing
        How far features spread along the surface before the field is fitted to them, as a part of half the longest
        side of the box; 0 fits the pixels as they are, as the paper does, and then the length of the fit decides how
        well its weights tell parts apart. What spreads, and why, stands in `dfd.distillation.smoothing`.
    octaves
        Wavelengths of the sines that the field's network is given beside the coordinates; 0 is the paper's network.
    steps, batch, learning_rate
        Length of the fit, surface points per step, peak of its one-cycle rate.
    seed
        Equal seeds give equal fields on one machine.
    device
        Where torch computes, such as "cpu" or "cuda"; None takes a CUDA device when there is one.
    progress
        True draws bars on standard error; a `Stages` also collects how long each stage took.
    cache
        Take the field from the user's cache when the same mesh was distilled with the same settings before, and keep it
        there otherwise. Where that is, and its other uses: `dfd.common.cache`.
    checkpoint
        A folder that keeps what is done, every few seconds, for as long as the call lasts. A call that was stopped,
        by whatever, goes on from there when it is made again, to the same bits; one with another mesh or other settings
        begins anew and says so.

    Returns
    -------
    Field, with all settings and the loss of every step in `field.settings`.

    Raises
    ------
    ValueError
        If an argument is out of its range, the encoder is unknown, no camera sees the mesh, or `checkpoint` is a folder
        of something else.
    OSError
        If the encoder's weights cannot be found or read, or `checkpoint` cannot be made.
    MemoryError
        If memory runs out, with what to lower.

    Warns
    -----
    RuntimeWarning
        If the cache cannot be written, or what is done cannot be kept; the call goes on.

    Source: paper, Eq. 2 and 3 and supplement L.
    """
    settings = _checked(
        views=views,
        resolution=resolution,
        framing=framing,
        simplify_to=simplify_to,
        supervision=supervision,
        mirrored=mirrored,
        smoothing=smoothing,
        octaves=octaves,
        steps=steps,
        batch=batch,
        learning_rate=learning_rate,
        seed=seed,
    )
    from dfd.mesh.mesh import as_mesh  # which imports trimesh

    mesh = as_mesh(mesh)
    of_fit = {name: settings[name] for name in ("octaves", "steps", "batch", "learning_rate", "seed")}
    smoothing, octaves, steps, batch, learning_rate, seed = settings["smoothing"], *of_fit.values()
    stages = progress if isinstance(progress, Stages) else Stages(show=bool(progress))

    if features is not None:
        from dfd.distillation.vertex_features import fit_features

        return fit_features(mesh, features, of_fit, device=device, stages=stages, cache=cache, checkpoint=checkpoint)
    with stages.stage("load"):
        known = _run(mesh, encoder, settings, device, cache, checkpoint)
        found = known.found() if known else None
    if found is not None:
        return found
    with stages.stage("load"), _no_garbage_collection():  # most of which is importing these
        import torch

        from dfd.distillation.fit import descend
        from dfd.distillation.main_directions import turned
        from dfd.distillation.smoothing import diffuse
        from dfd.distillation.targets import PixelTargets, PointTargets
        from dfd.encoders.encode import Encoder, load_encoder
        from dfd.field.field import Field
        from dfd.runs.recipe import plain, recipe
        from dfd.runs.run import Run
        from dfd.views.render import render

        model = encoder if isinstance(encoder, Encoder) else load_encoder(encoder, device=device)
        run = Run(recipe(mesh, **settings, **_loaded(encoder, device, model)), cache, checkpoint)
    with run.step("the pictures", "lower `resolution` or `views`"):
        seen = render(
            mesh,
            views=views,
            resolution=resolution,
            framing=framing,
            mirrored=mirrored,
            simplify_to=simplify_to,
            supervision=supervision,
            stages=stages,
        )
    run.begin()
    with run.step("the tokens", "lower `resolution` or `views`, or take a smaller encoder"):
        tokens = run.encode(model, seen.images, seen.covered, stages=stages)
    with run.step("the fit", "lower `batch`, `resolution` or `views`"):
        pixels = PixelTargets(seen, tokens, model.device)
        targets: PixelTargets | PointTargets = pixels
        dimension, directions = tokens.shape[-1], None
        if smoothing > 0:
            with stages.stage("spread"):
                points, main, directions = diffuse(seen, pixels, smoothing=smoothing, seed=seed)
            targets, dimension = PointTargets(points, main, model.device), len(directions)
        generator = torch.Generator().manual_seed(seed)
        field = Field.seeded(seed, dimension, octaves=octaves, center=seen.center, scale=seen.scale)
        field.to(model.device)
        losses = descend(
            field,
            lambda: targets.draw(batch, generator),
            steps=steps,
            learning_rate=learning_rate,
            generator=generator,
            stages=stages,
            state=run.fit_state(seen.points, seen.view, seen.row, seen.column, tokens),
        )
        if directions is not None:
            field = turned(field, directions)
    field.settings = {**model.settings(), **plain(settings), "losses": losses}
    return run.finish(field)


def find_distilled(mesh: Content, encoder: str | PathLike[str] = "dinov2-small", **given: Any) -> CachedField | None:
    """Return what `distill` would take from the user's cache for the same arguments, or None where it would work.

    No torch is imported for it, which takes longer than all the rest.

    Raises
    ------
    ValueError
        If an argument is out of its range.
    """
    call = signature(distill).bind(mesh, encoder, **given)
    call.apply_defaults()
    options = call.arguments
    if not options["cache"] or options["features"] is not None:
        return None
    settings = _checked(**{name: options[name] for name in signature(_checked).parameters})
    run = _run(mesh, encoder, settings, options["device"], True, options["checkpoint"])
    return run.found_file() if run else None


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Importing makes a million objects that stay: searching them for garbage, over and over, takes a tenth of it."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _checked(
    *,
    views: int,
    resolution: int,
    framing: str,
    simplify_to: int | None,
    supervision: str,
    mirrored: bool,
    smoothing: float,
    octaves: int,
    steps: int,
    batch: int,
    learning_rate: float,
    seed: int,
) -> dict[str, Any]:
    """What a field depends on besides its mesh and encoder; what concerns the pictures is checked by `render`."""
    if supervision not in ("barycentric", "vertex"):
        raise ValueError(f"distill: `supervision` must be 'barycentric' or 'vertex', got {supervision!r}")
    smoothing = check.number("distill", "smoothing", smoothing, minimum=0.0, maximum=2.0)
    return {
        "views": views,
        "resolution": resolution,
        "framing": framing,
        "simplify_to": simplify_to,
        "supervision": supervision,
        "mirrored": bool(mirrored),
        "smoothing": 0.0 if supervision == "vertex" else smoothing,  # the ablation is of the paper's own loss
        "octaves": check.whole("distill", "octaves", octaves, minimum=0, maximum=16),
        "steps": check.whole("distill", "steps", steps, minimum=1),
        "batch": check.whole("distill", "batch", batch, minimum=1),
        "learning_rate": check.number("distill", "learning_rate", learning_rate, minimum=0.0, exclusive=True),
        "seed": check.whole("distill", "seed", seed, minimum=0, maximum=2**63 - 1),
    }


def _run(
    mesh: Content,
    encoder: str | PathLike[str] | Encoder,
    settings: Mapping[str, Any],
    device: str | None,
    cache: bool,
    checkpoint: str | PathLike[str] | None,
) -> Run | None:
    """The run that an encoder's weights would have as they are at hand; None where they are not."""
    from dfd.runs.recipe import recipe
    from dfd.runs.run import Run

    source = _source(encoder, device)
    return Run(recipe(mesh, **settings, **source), cache, checkpoint) if source else None


def _source(encoder: str | PathLike[str] | Encoder, device: str | None) -> dict[str, Any] | None:
    """What tells the encoder from any other, without loading it; None where its weights are not at hand."""
    from dfd.encoders.sources import find_fingerprint

    if not isinstance(encoder, str | PathLike):
        if not hasattr(encoder, "identity"):
            raise ValueError(f"distill: `encoder` must be a name, a folder or a loaded Encoder, got {encoder!r}")
        return encoder.identity()
    weights = find_fingerprint(encoder)
    place = None if device is None else str(device)
    return {"encoder": os.fspath(encoder), "encoder_weights": weights, "device": place} if weights else None


def _loaded(encoder: str | PathLike[str] | Encoder, device: str | None, model: Encoder) -> dict[str, Any]:
    """As `_source`, once the encoder is loaded: the hub may have given other weights than those that were at hand."""
    source = _source(encoder, device)
    weights = model.settings()["encoder_weights"]
    return source if source and str(source["encoder_weights"]).startswith(str(weights)) else model.identity()
