"""Suite for asv: taking pictures."""

from __future__ import annotations

import dfd
from dfd.views.render import render

from .made_input import torus


class Render:
    """As many pictures of as many pixels as a distillation takes."""

    params = (20_000, 200_000)
    param_names = ("faces",)

    def setup(self, faces: int) -> None:
        """Make the mesh."""
        self.mesh = dfd.Mesh(*torus(faces))

    def time_render(self, faces: int) -> None:
        """Pictures, and the surface points behind their pixels."""
        render(self.mesh, views=24, resolution=518)
