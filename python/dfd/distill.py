"""From a mesh to its feature field: render, encode, fit (paper, sections 3.1 and 3.2)."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from dfd import check
from dfd.progress import Stages

# torch and transformers take seconds to import; they wait until something is distilled.
if TYPE_CHECKING:
    from dfd.encode import Encoder
    from dfd.field import Field
    from dfd.mesh import Mesh

__all__ = ["distill"]


def distill(
    mesh: Mesh,
    encoder: str | PathLike[str] | Encoder = "dinov2-small",
    *,
    views: int = 24,
    resolution: int = 518,
    framing: str = "shape",
    simplify_to: int | None = None,
    supervision: str = "barycentric",
    steps: int = 150,
    batch: int = 8192,
    learning_rate: float = 3e-3,
    seed: int = 0,
    device: str | None = None,
    progress: bool | Stages = True,
) -> Field:
    """Distil the features of an image encoder into a field around `mesh`.

    Parameters
    ----------
    mesh
        The shape, with or without textures, holes, loose parts and faces of no area.
    encoder
        A preset's name, a folder with weights, a hub name, or an encoder that is loaded already.
    views, resolution
        How many pictures are taken from around the shape, and the pixels along a side of each.
    framing
        "shape": every view is filled by the shape; "paper": the cameras of the paper, at a distance of 2.8.
    simplify_to
        Take the pictures of a copy of at most so many faces, as the paper does above 50,000; None casts rays at the
        mesh itself, which is faster up to several million faces and loses nothing.
    supervision
        "barycentric" fits every covered pixel (Eq. 2); "vertex" only pixels that hold a vertex, the paper's ablation.
    steps, batch, learning_rate
        Length of the fit, surface points per step, peak of its one-cycle rate.
    seed
        Equal seeds give equal fields on one machine.
    device
        Where torch computes, such as "cpu" or "cuda"; None takes a CUDA device when there is one.
    progress
        True draws bars on standard error; a `Stages` also collects how long each stage took.

    Returns
    -------
    Field, with all settings and the loss of every step in `field.settings`.

    Raises
    ------
    ValueError
        If an argument is out of its range, the encoder is unknown, or no camera sees the mesh.
    OSError
        If the encoder's weights cannot be found or read.

    Source: paper, Eq. 2 and 3 and supplement L.
    """
    if supervision not in ("barycentric", "vertex"):
        raise ValueError(f"distill: `supervision` must be 'barycentric' or 'vertex', got {supervision!r}")
    for name, value in (("steps", steps), ("batch", batch)):
        if not isinstance(value, int | np.integer) or value < 1:
            raise ValueError(f"distill: `{name}` must be a whole number of at least 1, got {value!r}")
    learning_rate = check.number("distill", "learning_rate", learning_rate, minimum=0.0, exclusive=True)
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise ValueError(f"distill: `seed` must be a whole number from 0 to 2⁶³ − 1, got {seed!r}")
    stages = progress if isinstance(progress, Stages) else Stages(show=bool(progress))

    import torch

    from dfd.encode import Encoder, load_encoder
    from dfd.field import Field
    from dfd.fit import Samples, fit
    from dfd.render import render

    with stages.stage("load"):
        model = encoder if isinstance(encoder, Encoder) else load_encoder(encoder, device=device)
    seen = render(
        mesh,
        views=views,
        resolution=resolution,
        framing=framing,
        simplify_to=simplify_to,
        supervision=supervision,
        stages=stages,
    )
    tokens = model.encode(seen.images, stages=stages)
    samples = Samples(seen.points, seen.view, seen.row, seen.column)

    with torch.random.fork_rng(devices=()):  # the caller's own random numbers stay as they were
        torch.manual_seed(seed)
        field = Field(tokens.shape[-1], center=seen.center, scale=seen.scale).to(model.device)
    losses = fit(
        field,
        samples,
        tokens,
        seen.images.shape[1],
        steps=steps,
        batch=batch,
        learning_rate=learning_rate,
        generator=torch.Generator().manual_seed(seed),
        stages=stages,
    )
    field.settings = {
        **model.settings(),
        "views": views,
        "resolution": resolution,
        "framing": framing,
        "simplify_to": simplify_to,
        "supervision": supervision,
        "steps": steps,
        "batch": batch,
        "learning_rate": learning_rate,
        "seed": seed,
        "losses": losses,
    }
    return field.cpu()
