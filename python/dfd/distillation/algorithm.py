"""Distill a field (paper, section 3): render, encode, smooth along the surface, fit."""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dfd.common.progress import Stages
from dfd.common.threads import beside, one_blas_thread
from dfd.distillation.fit import fit, fit_component_residuals, widen
from dfd.distillation.metric import Metric, find_metric
from dfd.distillation.settings import DistillSettings
from dfd.distillation.smoothing import build_diffusion, smooth_along_surface
from dfd.distillation.targets import PixelTargets, PointTargets, TokenGrid, side_by_side
from dfd.distillation.thickness import thickness_bands
from dfd.encoders.encode import Encoder
from dfd.field.field import Field
from dfd.upright.find_up import resolve_up
from dfd.upright.probe import find_probe
from dfd.views.render import render

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

_log = logging.getLogger(__name__)


@one_blas_thread()
def distill_pictures(mesh: Mesh, encoder: Encoder, settings: DistillSettings, *, stages: Stages) -> Field:
    """Render pictures of `mesh`, encode them with `encoder`, and return a field that is fitted to the features."""
    smoothing, seed = settings.smoothing, settings.seed
    metric = find_metric(encoder) if settings.metric == "learned" else None
    recorded = {**encoder.settings(), **settings.as_dict(), **_lacking(encoder, settings, metric)}
    recorded |= {"block": None if encoder.default_block else encoder.block, "background": not encoder.foreground_only}
    recorded["encoded_resolution"] = encoder.nearest_resolution(settings.resolution)
    recorded |= {"metric": "learned", "metric_hash": metric.content_hash} if metric else {"metric": "none"}

    up = resolve_up(mesh, encoder, settings.up, stages=stages)
    if smoothing == 0 and up.shared is not None:  # features of two up directions can be combined only after smoothing
        up = replace(up, shared=None, shares=None, source="found")
    pictures = settings.of_pictures()
    pictures["views"] = max(settings.views // len(up.frames), 1)  # the same number of views for each up direction
    views = [render(mesh, **pictures, frame=frame, stages=stages) for frame in up.frames]  # with the points P (Eq. 2)
    images, covered = (np.concatenate([getattr(each, name) for each in views]) for name in ("images", "covered"))
    encode = partial(encoder.encode, images, covered=covered, stages=stages)
    targets: PixelTargets | PointTargets
    if smoothing == 0:
        targets = PixelTargets(views[0], encode())  # one target Z for each covered pixel
    else:
        side = encoder.nearest_resolution(settings.resolution) // encoder.patch
        build = partial(build_diffusion, smoothing=smoothing, seed=seed)
        # `build` mostly uses one core, so it runs while the encoder uses the other cores.
        with beside(lambda: [build(each, TokenGrid(each, side, side)) for each in views]) as problems:
            tokens = np.split(encode(), len(views))
        by_up = []
        for each, own, problem in zip(views, tokens, problems(), strict=True):
            smooth = smooth_along_surface(PixelTargets(each, own), problem, stages=stages)
            by_up.append(metric.of_targets(smooth, thickness_bands(each, smooth), seed) if metric else smooth)
        targets = by_up[0] if up.shares is None else side_by_side(by_up, up.shares)

    # The fit minimizes ‖Φ(P) − Z‖² (Eq. 3).
    field = fit(targets, settings, center=views[0].center, scale=views[0].scale, device=encoder.device, stages=stages)
    if settings.pieces and isinstance(targets, PointTargets):
        field = fit_component_residuals(field, targets)
    if targets.directions is not None:
        field = widen(field, targets.directions)
    return field.with_settings({**recorded, **up.settings, **field.settings})


def _lacking(encoder: Encoder, settings: DistillSettings, metric: Metric | None) -> dict[str, Any]:
    """Warn about learned data that `encoder` lacks. Return the setting "encoder_lacks", or {} if no data is missing."""
    lacking = []
    if settings.metric == "learned" and metric is None:
        lacking.append("no metric was learned for it, so distances are those of its features")
    if settings.up == "auto" and find_probe(encoder) is None:
        lacking.append("no up probe was learned for it, so up is the file's +y")
    if not lacking:
        return {}
    _log.warning("encoder %s, block %d: %s", encoder.name, encoder.block, "; ".join(lacking))
    return {"encoder_lacks": lacking}
