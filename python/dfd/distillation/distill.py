"""`dfd.distill`: what stands around a distillation, so that it is found again, goes on, and says what it lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from inspect import Parameter, signature
from os import PathLike
from typing import TYPE_CHECKING, Any

from dfd.common.importing import importing
from dfd.common.interrupts import heed_interrupts
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillOptions, DistillSettings
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.runs import field_cache
from dfd.runs.checkpoint import Checkpoint
from dfd.runs.lookup import find_field
from dfd.runs.recipe import recipe

# torch and transformers take seconds to import; they wait until something is distilled.
if TYPE_CHECKING:
    from concurrent.futures import Future

    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from dfd.encoders.encode import Encoder
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh, MeshLike
    from dfd.runs.recipe import Content

__all__ = ["distill", "distilling", "find_distilled"]

# What a stage needs memory for, and what lowers that.
_PICTURES = "the pictures: lower `resolution` or `views`"
_FIT = "the fit: lower `batch`, `resolution` or `views`"
_ADVICE = {
    "load": _PICTURES,
    "up": _PICTURES,
    "simplify": _PICTURES,
    "render": _PICTURES,
    "encode": "the tokens: lower `resolution` or `views`, or take a smaller encoder",
    "spread": _FIT,
    "fit": _FIT,
}


def distill(
    mesh: MeshLike,
    encoder: str | PathLike[str] | Encoder = DEFAULT_ENCODER,
    *,
    features: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    device: str | None = None,
    progress: bool | Stages = True,
    cache: bool = True,
    checkpoint: str | PathLike[str] | None = None,
    **settings: Unpack[DistillOptions],
) -> Field:
    """Distill the features of an image encoder, or features that are given, into a field around `mesh`.

    Parameters
    ----------
    mesh
        The shape, or whatever `dfd.load` makes one of; with or without textures, holes, loose parts and faces of no
        area.
    encoder
        A known encoder's name, a folder with weights, a hub name, or an encoder that is loaded already.
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
    up
        Which way is up: "+y", "-z" and the like, a direction, "file" for the +y that files have by convention, or
        "auto", which looks (see `dfd.distillation.upright.find_up`). Cameras stand upright and mirror each other in a
        frame with this up; mesh and field keep their own coordinates. What was found, and how sure, stands in
        `field.settings` as "up_direction", "up_confidence" and "up_source": "file", "found", "averaged" where two
        directions share the pictures because none is clear, or "said".
    supervision
        "barycentric" fits every covered pixel (Eq. 2); "vertex" only pixels that hold a vertex, the paper's ablation.
    mirrored
        Take the views in fours that are each other's mirror images at the upright middle planes, pictures included: the
        encoder's own sense of left and right evens out.
    smoothing
        How far features spread along the surface before the field is fitted to them, as a part of half the longest
        side of the box; 0 fits the pixels as they are, as the paper does, and then the length of the fit decides how
        well its weights tell parts apart. What spreads, and why, stands in `dfd.distillation.smoothing`.
    metric
        "learned" fits features that went, with how thick the shape is around each point, through the metric that was
        learned for this encoder, see `dfd.distillation.metric`: parts are told apart better, and a feature has fewer
        numbers. "none" is the paper's distance, of what is seen alone, and what is taken without smoothing and where no
        metric comes with the package for an encoder's weights and block; the field's `settings` say which it was, and
        as "encoder_lacks" what was not learned for the encoder, which is also logged as a warning.
    octaves
        Wavelengths of the sines that the field's network is given beside the coordinates; 0 is the paper's network.
    steps, batch, learning_rate
        Length of the fit, surface points per step, peak of its one-cycle rate.
    seed
        Equal seeds give equal fields on one machine. The precision of a named encoder is decided once on it, by
        `dfd.encoders.encode.load_encoder`, and is `field.settings["encoder_precision"]`.
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
        begins anew and says so, and so does what is damaged.

    Returns
    -------
    Field, with all settings and the loss of every step in `field.settings`. Of a mesh in pieces that no edge connects
    it also keeps what each looks like, so that a helmet is told from the head in it: see `dfd.field.pieces`.

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
    UserWarning
        If what `checkpoint` keeps is of other settings or damaged, and begun anew.

    Source: paper, Eq. 2 and 3 and supplement L.
    """
    from dfd.mesh.mesh import as_mesh

    stages = progress if isinstance(progress, Stages) else Stages(show=bool(progress))
    unknown = settings.keys() - DistillOptions.__annotations__.keys()
    if unknown:
        raise TypeError(f"distill() got an unexpected keyword argument {min(unknown)!r}")
    with distilling(
        as_mesh(mesh),
        encoder,
        DistillSettings(**settings),
        features=features,
        device=device,
        stages=stages,
        cache=cache,
        checkpoint=checkpoint,
    ) as field:
        return field


# What help() and editors show are the settings themselves.
distill.__signature__ = signature(distill).replace(  # type: ignore[attr-defined]
    parameters=[
        *(each for each in signature(distill).parameters.values() if each.kind is not Parameter.VAR_KEYWORD),
        *signature(DistillSettings).parameters.values(),
    ]
)


@contextmanager
def distilling(
    mesh: Mesh,
    encoder: str | PathLike[str] | Encoder,
    settings: DistillSettings,
    *,
    features: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
    device: str | None = None,
    stages: Stages,
    cache: bool = True,
    checkpoint: str | PathLike[str] | None = None,
    loading: Future[Encoder] | None = None,
) -> Iterator[Field]:
    """Do what `distill` does for a block that writes the field: the checkpoint stays if the block fails.

    `loading` gives the `encoder` of that name, which somebody began to load before.
    """
    with stages.stage("load"), importing():
        known = find_recipe(mesh, encoder, settings, device) if features is None else None
        found = find_field(known, checkpoint) if known and cache else None
        if found is None:
            if features is None:
                work = _of_pictures(mesh, encoder, settings, device, loading)
            else:
                work = _of_features(mesh, features, settings, device)
            if cache and work.recipe != known:
                found = find_field(work.recipe, checkpoint)
    if found is not None:
        yield found
        return
    kept = None if checkpoint is None else Checkpoint(checkpoint, work.recipe)
    with _guarded(work, stages, kept):
        field = work.run(stages=stages, kept=kept)
    if cache:
        field_cache.store(work.recipe, field)
    yield field
    if kept is not None:
        kept.remove()


def find_distilled(
    mesh: Content,
    encoder: str | PathLike[str] | Encoder,
    settings: DistillSettings,
    *,
    device: str | None = None,
    checkpoint: str | PathLike[str] | None = None,
) -> Field | None:
    """Return what `distill` would take from the user's cache for the same arguments, or None where it would work.

    No torch is imported for it, which takes longer than all the rest.
    """
    known = find_recipe(mesh, encoder, settings, device)
    return find_field(known, checkpoint) if known else None


def find_recipe(
    mesh: Content, encoder: str | PathLike[str] | Encoder, settings: DistillSettings, device: str | None
) -> dict[str, Any] | None:
    """Return all that the field depends on, without loading the encoder; None where that is not known before.

    Raises
    ------
    ValueError
        If `encoder` is none.
    """
    from dfd.encoders.identity import find_identity

    if not isinstance(encoder, str | PathLike) and not hasattr(encoder, "identity"):
        raise ValueError(f"distill: `encoder` must be a name, a folder or a loaded Encoder, got {encoder!r}")
    identity = find_identity(encoder, device)
    return recipe(mesh, **settings.as_dict(), **identity) if identity else None


@dataclass(frozen=True)
class _Work:
    """A distillation that is ready to begin: by what its result is known, and what is to be done."""

    recipe: Mapping[str, Any]
    run: Callable[..., Field]  # stages and kept
    advice: Mapping[str, str]  # when memory runs out in a stage


def _of_pictures(
    mesh: Mesh,
    encoder: str | PathLike[str] | Encoder,
    settings: DistillSettings,
    device: str | None,
    loading: Future[Encoder] | None,
) -> _Work:
    with heed_interrupts(wait=True):
        from dfd.distillation.algorithm import distill_pictures
        from dfd.encoders.encode import Encoder, load_encoder
        from dfd.encoders.identity import loaded_identity

    if loading is not None:
        model = loading.result()
    else:
        model = encoder if isinstance(encoder, Encoder) else load_encoder(encoder, device=device)
    made_of = recipe(mesh, **settings.as_dict(), **loaded_identity(encoder, device, model))
    return _Work(made_of, partial(distill_pictures, mesh, model, settings), _ADVICE)


def _of_features(
    mesh: Mesh, features: ArrayLike | tuple[ArrayLike, ArrayLike], settings: DistillSettings, device: str | None
) -> _Work:
    with heed_interrupts(wait=True):
        from dfd.common.devices import choose_device
        from dfd.distillation.vertex_features import GivenFeatures, distill_features

    target = choose_device("distill", device)
    given = GivenFeatures(mesh, features)
    made_of = recipe(mesh, **settings.of_fit(), features=given.kind, given=given.sha256(), device=str(target))
    advice = {"fit": "the fit: lower `batch`, or give features with fewer columns"}
    return _Work(made_of, partial(distill_features, given, settings, device=target), advice)


@contextmanager
def _guarded(work: _Work, stages: Stages, kept: Checkpoint | None) -> Iterator[None]:
    """Watch over the work itself.

    Raises
    ------
    MemoryError
        With advice, when memory runs out in whatever way.
    ValueError
        What the work itself raises: a checkpoint goes then, for it would only lead here again.
    """
    try:
        yield
    except ValueError:
        if kept is not None:
            kept.remove()
        raise
    except (MemoryError, RuntimeError) as error:
        from dfd.common.devices import out_of_memory

        if not out_of_memory(error) or str(error).startswith("encode: "):
            raise
        advice = work.advice.get(stages.latest or "", next(iter(work.advice.values())))
        raise MemoryError(f"distill: too little memory for {advice}") from error
