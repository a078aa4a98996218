"""Make a wavy sheet at any resolution, and an edit of it."""

import numpy as np

from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, Fixed, Handle
from dfd.editing.points import Place, place_on
from dfd.editing.regions import Ball, Box, HalfSpace
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Transform
from dfd.symmetry.plane import SymmetryPlane

__all__ = ["full_edit", "grid"]


def grid(size):
    """Return a wavy sheet of size × size vertices over the unit square, centered on x = 0."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.5, 0.5, size), np.linspace(0, 1, size)))
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + size], 1), np.stack([corner + 1, corner + size + 1, corner + size], 1)]
    )
    return Mesh(np.stack([x, 0.1 * np.cos(3 * x) * z, z], axis=1), faces)


def full_edit(mesh):
    """Return an edit that uses every field of an edit."""
    axes = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    turned = Transform((0.0, 0.25, 0.0), (0.0, 0.0, 30.0), (1.0, 2.0, 0.5), (0.5, 0.5, 0.5), axes)
    near = Controls(
        0.8,
        "smooth",
        radius=0.25,
        strength=0.5,
        counterparts="own_pivot",
        excluded_counterparts=(place_on(mesh, 60), Place((0.3, 0.1, 0.5))),
        mask=Ball((0.01, 0.0, 0.0), 0.7),
        mask_feather=0.125,
    )
    return Edit(
        handles=(
            Handle(3, place_on(mesh, 40), turned, Controls(locality=2.5), name="ear, links ◔"),
            Handle(1, Place((0.1, 0.2, 1 / 3)), controls=Controls(reach=0.3)),
            Handle(7, place_on(mesh, np.array([3, 4, 5])), controls=near),
        ),
        fixed=(
            Fixed(place_on(mesh, 7)),
            Fixed(Place((0.9, 0.9, 0.9)), 0.25),
            Fixed(place_on(mesh, Box((-1, -1, 0.9), (-0.4, 1, 1)))),
            Fixed(place_on(mesh, HalfSpace((0.0, 0.0, -2.0), -0.02)), 0.5),
        ),
        symmetry=SymmetryPlane((1.0, 0.0, 0.0), 0.01, band=0.05),
        default=Transform(scale=(2.0, 2.0, 2.0)),
        preset="paper",
    )
