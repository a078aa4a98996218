"""Make a field from the geometry of a mesh alone, for the time before the features of an encoder are known."""

import numpy as np

from dfd.field.vertex_field import VertexField
from dfd.geometry.normalization import normalization
from dfd.mesh.mesh import Mesh

DIMENSION = 32
SPREAD = 1.2  # standard deviation of the frequencies, radians per half of the longest side of the bounding box


def geometry_field(mesh: Mesh) -> VertexField:
    """Return a field of smooth random functions of the position, which are equal at x and −x.

    Near points have similar features, so parts are found from creases and lengths. Both sides of a shape that is
    symmetric about x are alike. Source: Rahimi and Recht 2007, Random Features for Large-Scale Kernel Machines.
    """
    center, scale = normalization(mesh)
    places = (mesh.vertices - np.asarray(center)) * scale
    places[:, 0] = np.abs(places[:, 0])
    random = np.random.default_rng(0)
    frequencies = SPREAD * random.standard_normal((3, DIMENSION))
    features = np.cos(places @ frequencies + random.uniform(0.0, 2.0 * np.pi, DIMENSION))
    return VertexField(mesh, features, settings={"features": "geometry"})
