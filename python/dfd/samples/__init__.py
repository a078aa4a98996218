"""Generate shapes for tests and demos, with labels that name the part of each vertex.

All shapes are upright (+y), face +z and are about 1 high. "Right" means +x. The plane x = 0 is an exact mirror plane.
"""

from dataclasses import dataclass

import numpy as np

from dfd.common import check
from dfd.common.linear_algebra import Int32, Int64
from dfd.mesh.mesh import Mesh
from dfd.samples.implicit import Distance, Primitive, Shape, capsule, chain, ellipsoid, rounded_box
from dfd.samples.polygonize import polygonize

__all__ = ["Sample", "chair", "quadruped", "robot"]

_FEWEST_FACES = 4000  # smallest number of faces; with fewer, the grid is too coarse for horns and tails
_MOST_FACES = 10_000_000


@dataclass(frozen=True)
class Sample:
    """A generated mesh and the labels of its parts."""

    mesh: Mesh  #: the generated mesh
    labels: Int32  #: (V,) the kind of part of each vertex, as an index into `parts`
    instances: Int32  #: (V,) the index of each vertex's part among the parts of its kind, such as 0 to 3 for four legs
    parts: tuple[str, ...]  #: the names of the kinds of parts, such as "leg"

    def vertices_of(self, part: str, instance: int | None = None) -> Int64:
        """Return the vertex indices (N,) of all parts of the kind `part`, or only of the one with the index `instance`.

        Raises ValueError if `part` is not one of `parts`.
        """
        if part not in self.parts:
            raise ValueError(f"Sample.vertices_of: `part` must be one of {', '.join(self.parts)}, got {part!r}")
        chosen = self.labels == self.parts.index(part)
        if instance is not None:
            chosen &= self.instances == instance
        return np.flatnonzero(chosen)


def chair(faces: int = 20_000) -> Sample:
    """Return a chair of about `faces` faces.

    Parts: leg (4: front right, front left, back right, back left), seat, back.

    Raises ValueError if `faces` is below 4,000 or above 10,000,000.
    """
    primitives = [
        Primitive("seat", rounded_box((0, 0.46, 0.02), (0.25, 0.035, 0.24), 0.03)),
        Primitive(
            "back", rounded_box((0, 0.80, -0.235), (0.235, 0.22, 0.022), 0.02, pitch=-0.10, bend=0.55), blend=0.03
        ),
        Primitive("back", capsule((0.185, 0.47, -0.185), (0.195, 0.66, -0.20), 0.026, 0.024), blend=0.03),
        Primitive("leg", capsule((0.195, 0.44, 0.19), (0.225, 0.025, 0.235), 0.034, 0.019), 0, True, 0.03),
        Primitive("leg", capsule((0.195, 0.44, -0.16), (0.225, 0.025, -0.235), 0.034, 0.019), 2, True, 0.03),
    ]
    return _sample("chair", primitives, faces)


def quadruped(faces: int = 20_000) -> Sample:
    """Return an animal with horns, of about `faces` faces.

    Parts: body, neck, head, tail, ear (2), horn (2), leg and hoof (4: front right, front left, back right, back left).

    Raises ValueError if `faces` is below 4,000 or above 10,000,000.
    """
    front = [(0.105, 0.50, 0.23), (0.115, 0.29, 0.235), (0.115, 0.09, 0.23)]
    back = [(0.095, 0.50, -0.24), (0.115, 0.33, -0.23), (0.115, 0.22, -0.315), (0.115, 0.09, -0.30)]
    primitives = [
        Primitive("body", capsule((0, 0.54, -0.24), (0, 0.56, 0.20), 0.165, 0.175)),
        Primitive("body", ellipsoid((0, 0.50, -0.02), (0.185, 0.17, 0.26)), blend=0.08),
        Primitive("body", ellipsoid((0, 0.52, 0.26), (0.14, 0.16, 0.13)), blend=0.08),
        Primitive("neck", capsule((0, 0.60, 0.28), (0, 0.83, 0.44), 0.115, 0.08), blend=0.08),
        Primitive("head", ellipsoid((0, 0.885, 0.49), (0.09, 0.088, 0.105)), blend=0.05),
        Primitive("head", capsule((0, 0.875, 0.50), (0, 0.80, 0.645), 0.072, 0.055), blend=0.05),
        Primitive("ear", ellipsoid((0.135, 0.90, 0.445), (0.07, 0.030, 0.018), roll=0.25), 0, True, 0.02),
        *_pair("leg", 0, chain(front, [0.078, 0.044, 0.030]), 0.05),
        *_pair("leg", 2, chain(back, [0.105, 0.062, 0.040, 0.029]), 0.05),
        Primitive("hoof", capsule((0.115, 0.072, 0.232), (0.115, 0.03, 0.245), 0.034, 0.044), 0, True, 0.015),
        Primitive("hoof", capsule((0.115, 0.072, -0.298), (0.115, 0.03, -0.285), 0.034, 0.044), 2, True, 0.015),
        *_pair("horn", 0, chain(_HORN, [0.028, 0.024, 0.017, 0.009]), 0.015),
        *[Primitive("tail", primitive, blend=0.03) for primitive in chain(_TAIL, [0.032, 0.022, 0.018])],
        Primitive("tail", ellipsoid((0, 0.30, -0.525), (0.032, 0.075, 0.032)), blend=0.03),
    ]
    return _sample("quadruped", primitives, faces)


def robot(faces: int = 20_000) -> Sample:
    """Return a robot of about `faces` faces.

    Parts: torso, head, arm, hand, leg, foot. Arms, hands, legs and feet have the instances 0 (right) and 1 (left).

    Raises ValueError if `faces` is below 4,000 or above 10,000,000.
    """
    primitives = [
        Primitive("torso", rounded_box((0, 0.60, 0), (0.155, 0.155, 0.10), 0.05)),
        Primitive("torso", rounded_box((0, 0.435, 0), (0.105, 0.06, 0.08), 0.04), blend=0.03),
        Primitive("head", capsule((0, 0.74, 0), (0, 0.80, 0), 0.045), blend=0.02),
        Primitive("head", rounded_box((0, 0.88, 0), (0.12, 0.09, 0.10), 0.045), blend=0.02),
        Primitive("head", ellipsoid((0.05, 0.895, 0.095), (0.03, 0.03, 0.022)), blend=0.008),
        Primitive("head", capsule((0, 0.96, 0), (0, 1.03, 0), 0.012), blend=0.01),
        Primitive("head", ellipsoid((0, 1.045, 0), (0.026, 0.026, 0.026)), blend=0.01),
        Primitive("arm", ellipsoid((0.195, 0.685, 0), (0.062, 0.062, 0.062)), 0, True, 0.015),
        *_pair("arm", 0, chain([(0.20, 0.68, 0), (0.255, 0.52, 0), (0.275, 0.36, 0.05)], [0.045, 0.036, 0.040]), 0.02),
        Primitive("hand", ellipsoid((0.280, 0.315, 0.062), (0.045, 0.052, 0.045)), 0, True, 0.012),
        *_pair("hand", 0, chain([(0.262, 0.30, 0.085), (0.245, 0.255, 0.105)], [0.018, 0.014]), 0.01),
        *_pair("hand", 0, chain([(0.305, 0.30, 0.085), (0.315, 0.25, 0.10)], [0.018, 0.014]), 0.01),
        *_pair("hand", 0, chain([(0.285, 0.29, 0.05), (0.285, 0.245, 0.05)], [0.018, 0.014]), 0.01),
        *_pair("leg", 0, chain([(0.085, 0.41, 0), (0.095, 0.23, 0.012), (0.10, 0.09, 0)], [0.060, 0.050, 0.055]), 0.02),
        Primitive("foot", rounded_box((0.105, 0.04, 0.035), (0.07, 0.04, 0.11), 0.035), 0, True, 0.02),
    ]
    return _sample("robot", primitives, faces)


_HORN = [(0.05, 0.95, 0.47), (0.10, 1.00, 0.455), (0.135, 1.06, 0.47), (0.14, 1.12, 0.50)]
_TAIL = [(0, 0.63, -0.375), (0, 0.56, -0.47), (0, 0.36, -0.52)]


def _pair(part: str, instance: int, distances: list[Distance], blend: float) -> list[Primitive]:
    return [Primitive(part, distance, instance, True, blend) for distance in distances]


def _sample(name: str, primitives: list[Primitive], faces: int) -> Sample:
    count = check.whole(f"samples.{name}", "faces", faces, minimum=_FEWEST_FACES, maximum=_MOST_FACES)
    shape = Shape(primitives)
    vertices, triangles = polygonize(shape, (-0.4, -0.05, -0.7), (0.4, 1.2, 0.8), count)
    labels, instances = shape.labels(vertices)
    return Sample(Mesh(vertices, triangles), labels, instances, shape.parts)
