"""Benchmarks for asv: the stages of a distillation, and rendering alone."""

import os

os.environ.setdefault("HF_HUB_OFFLINE", "1")  # use the installed encoder

import dfd
from dfd.common.progress import Stages
from dfd.views.render import render

from .made_input import torus


class Distill:
    """Time the stages of a distillation with the default encoder, few small pictures and a short fit."""

    params = ("up", "render", "encode", "smooth", "fit")
    param_names = ("stage",)
    unit = "s"

    def setup_cache(self) -> dict[str, float]:
        """Return the shortest time of each stage, in seconds."""
        mesh = dfd.samples.quadruped(10_000).mesh
        best: dict[str, float] = {}
        for _ in range(3):
            stages = Stages(show=False)
            dfd.distill(mesh, progress=stages, cache=False, views=4, resolution=224, steps=50)
            best = {stage: min(seconds, best.get(stage, seconds)) for stage, seconds in stages.seconds.items()}
        return best

    def track_seconds(self, best: dict[str, float], stage: str) -> float:
        """Return the seconds of the stage."""
        return best[stage]


class Render:
    """Render the pictures of a distillation, in the default number and resolution."""

    params = (20_000, 200_000)
    param_names = ("faces",)

    def setup(self, faces: int) -> None:
        """Make the mesh."""
        self.mesh = torus(faces)

    def time_render(self, faces: int) -> None:
        """Render the pictures, and compute the surface points of their pixels."""
        render(self.mesh, views=24, resolution=518)
