"""Distillation itself: render, encode, spread, fit (paper, sections 3.1 and 3.2).

The cache, checkpoints and all else that a long run needs stand around it, in `dfd.distillation.distill`.
"""

from __future__ import annotations

import logging
from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any

from dfd.common.parallel import beside
from dfd.common.progress import Stages
from dfd.common.threads import one_blas_thread
from dfd.distillation.fit import fit, widen
from dfd.distillation.metric import Metric, find_metric
from dfd.distillation.pieces import keep_pieces
from dfd.distillation.settings import DistillSettings
from dfd.distillation.smoothing import lay_ground, spread
from dfd.distillation.targets import PixelTargets, PointTargets, TokenGrid
from dfd.distillation.thickness import thickness_bands
from dfd.encoders.encode import Encoder
from dfd.field.field import Field
from dfd.upright.find_up import said_or_found
from dfd.upright.probe import find_probe
from dfd.views.render import Views, render

if TYPE_CHECKING:
    from dfd.distillation.checkpoint import Checkpoint
    from dfd.mesh.mesh import Mesh

__all__ = ["distill_pictures"]

_log = logging.getLogger(__name__)


@one_blas_thread()
def distill_pictures(
    mesh: Mesh, encoder: Encoder, settings: DistillSettings, *, stages: Stages, kept: Checkpoint | None = None
) -> Field:
    """Return the field around `mesh` of what `encoder` sees in its pictures; `kept` is where a stopped run goes on."""
    metric = find_metric(encoder) if settings.metric == "learned" else None
    up = said_or_found(mesh, encoder, settings.up, stages=stages)
    lacking = []
    if settings.metric == "learned" and metric is None:
        lacking.append("no metric was learned for it, and distances are those of its own features")
    if settings.up == "auto" and find_probe(encoder) is None:
        lacking.append("which way is up was not learned for it, and is taken to be the file's +y")
    if lacking:
        _log.warning("encoder %s, block %d: %s", encoder.name, encoder.block, "; ".join(lacking))
    views = render(mesh, **settings.of_pictures(), frame=up.frames, stages=stages)
    targets = _targets(views, encoder, settings, metric, stages=stages, kept=kept)
    field = fit(targets, settings, center=views.center, scale=views.scale, device=encoder.device, stages=stages)
    if settings.pieces and isinstance(targets, PointTargets):
        field = keep_pieces(field, targets)
    if targets.directions is not None:
        field = widen(field, targets.directions)
    of_metric = {"metric": "learned", "metric_hash": metric.content_hash} if metric else {"metric": "none"}
    of_encoder: dict[str, Any] = {"block": encoder.block, "background": not encoder.foreground_only}
    if lacking:
        of_encoder["encoder_lacks"] = lacking
    made_with = {**settings.as_dict(), **of_encoder, **of_metric}
    return field.with_settings({**encoder.settings(), **made_with, **up.settings, **field.settings})


def _targets(
    views: Views,
    encoder: Encoder,
    settings: DistillSettings,
    metric: Metric | None,
    *,
    stages: Stages,
    kept: Checkpoint | None,
) -> PixelTargets | PointTargets:
    """What the field is to give: features of pixels, as the paper has it, or, spread, of points on the surface."""
    smoothing, seed = settings.smoothing, settings.seed
    side = encoder.nearest_resolution(settings.resolution) // encoder.patch
    # Hardly any of it can be shared among threads: beside pictures it leaves no processor idle.
    lay = partial(lay_ground, views, TokenGrid(views, side, side), smoothing=smoothing, seed=seed)
    with beside(lay) if smoothing > 0 else nullcontext() as ground:
        tokens = encoder.encode(views.images, covered=views.covered, store=kept, stages=stages)
    pixels = PixelTargets(views, tokens)
    if smoothing == 0:
        return pixels
    targets = spread(views, pixels, smoothing=smoothing, seed=seed, stages=stages, ground=ground)
    return metric.of_targets(targets, thickness_bands(views, targets), seed) if metric else targets
