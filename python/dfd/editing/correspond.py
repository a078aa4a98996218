"""Find, for each vertex of a shape, the corresponding vertex of another shape of the same class."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfd.common.errors import public
from dfd.common.linear_algebra import Float32, Float64, Int64, unit
from dfd.common.read_only import ReadOnlyArrays
from dfd.editing.transfer import CANDIDATE_MARGIN, TOO_SHORT, check_fields, mean_feature
from dfd.field.field import Field
from dfd.mesh.mesh import MeshLike, as_mesh

MOST_VERTICES = 16_384  # largest number of vertices of the other shape that are compared; they are evenly spaced
ROWS = 512  # number of vertices that are compared together, which limits the memory
FAR = 0.25  # length of a way there and back, as a fraction of the diagonal, from which on the confidence is 0


@dataclass(frozen=True, eq=False)
class Correspondence(ReadOnlyArrays):
    """The corresponding vertex of another shape for each vertex, and its confidence."""

    vertices: Int64  # (V,) vertices of the other shape
    #: (V,) in [0, 1]: `similarity`, multiplied by 1 − d / (`FAR` · diagonal), where d is the distance between a vertex
    #: and the vertex that corresponds to its corresponding vertex
    confidence: Float32
    similarity: Float32  # (V,) in [0, 1]: the cosine between both features, each minus the mean of its shape


@public
def correspond(mesh_a: MeshLike, field_a: Field, mesh_b: MeshLike, field_b: Field) -> Correspondence:
    """Return the corresponding vertex of `mesh_b` for each vertex of `mesh_a`, a shape of the same class.

    It is the vertex with the most similar feature. Among vertices of nearly equal similarity, it is the one at the most
    similar position in the bounding box, so that left legs correspond to left legs. Both shapes must therefore stand
    upright and face the same direction. The mean feature of each shape is subtracted first. If a shape has more than
    16,384 vertices, as many of them can be corresponding vertices.

    Raises ValueError if the fields have different encoders or dimensions.

    Parameters
    ----------
    mesh_a, field_a
        The first shape and its feature field.
    mesh_b, field_b
        The other shape and its feature field, which was distilled with the same encoder.

    Returns
    -------
    correspondence
        (V,) `vertices` of `mesh_b`, and their `confidence` and `similarity`, (V,) in [0, 1].
    """
    check_fields(field_a, field_b)
    a, b = _Side(mesh_a, field_a), _Side(mesh_b, field_b)
    there, similarity = _nearest(a, np.arange(len(a.mesh.vertices)), b)
    used, inverse = np.unique(there, return_inverse=True)
    back = _nearest(b, used, a)[0][inverse]
    apart = np.linalg.norm(a.mesh.vertices[back] - a.mesh.vertices, axis=1)
    confidence = similarity * np.clip(1 - apart / (FAR * a.mesh.diagonal), 0, 1)
    return Correspondence(there, confidence.astype(np.float32), similarity.astype(np.float32))


class _Side:
    """One of both shapes: features minus their mean, at unit length, and positions in the bounding box."""

    def __init__(self, mesh: MeshLike, field: Field) -> None:
        self.mesh = as_mesh(mesh)
        mean = mean_feature(self.mesh, field)
        rows = np.asarray(field.on(self.mesh).rows(slice(None)), np.float64) - mean
        self.rows = unit(rows, least=TOO_SHORT).astype(np.float32)
        self.places: Float64 = (self.mesh.vertices - field.center) * field.scale
        count = len(self.mesh.vertices)
        self.sample = np.unique(self.mesh.representative[:: -(-count // MOST_VERTICES)]).astype(np.int64)


def _nearest(a: _Side, vertices: Int64, b: _Side) -> tuple[Int64, Float64]:
    """Return the corresponding vertices (N,) of `b` for `vertices` (N,) of `a`, and their similarities (N,)."""
    found, similarity = np.empty(len(vertices), np.int64), np.empty(len(vertices))
    rows, places = b.rows[b.sample], b.places[b.sample].astype(np.float32)
    squares = np.square(places).sum(axis=1)
    for start in range(0, len(vertices), ROWS):
        some = vertices[start : start + ROWS]
        cosines = a.rows[some] @ rows.T
        apart = np.sqrt(np.maximum(2 - 2 * cosines, 0))
        meant = a.places[some].astype(np.float32)
        distances = squares - 2 * meant @ places.T
        distances[apart > apart.min(axis=1, keepdims=True) + CANDIDATE_MARGIN] = np.inf
        best = distances.argmin(axis=1)
        found[start : start + ROWS] = b.sample[best]
        similarity[start : start + ROWS] = np.clip(cosines[np.arange(len(some)), best], 0, 1)
    return found, similarity
