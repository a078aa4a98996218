"""Find unusual properties of a mesh, and name their effect on each control."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from dfd.geometry.surface_graph import surface_graph
from dfd.geometry.topology import Topology, inspect
from dfd.mesh.mesh import Mesh

_FLAT = 1e-3  # least side of the box below which a shape is flat, relative to the longest side
# Distance from the origin, relative to the longest side, above which float32 rounds details of a thousandth of it.
_FAR = 1e4
_COARSE = 0.1  # median edge above which faces are large, in diagonals of the box


@dataclass(frozen=True)
class Finding:
    """An unusual property of a mesh."""

    what: str  # the property, a sentence with numbers
    means: str  # the effect on controls, a sentence


# Each row: a count of `Topology`, its words in singular and plural, the property, and its effect.
_ODD = (
    ("unreferenced_vertices", "vertex is", "vertices are", "{} of no face.",
     "Pictures do not show them; they have the weights of their positions, and move."),
    ("boundary_edges", "edge has", "edges have", "The surface is open: {} one face only.",
     "Weights and poses are not affected; distances along the surface go around holes, and volume cannot be kept."),
    ("non_manifold_edges", "edge has", "edges have", "{} more than two faces.",
     "Weights, poses, locality and symmetry are not affected; other programs may refuse the mesh."),
    ("degenerate_faces", "face has", "faces have", "{} no area.",
     "They are not rendered or measured; their corners move like all others."),
    ("duplicate_faces", "face repeats", "faces repeat", "{} an earlier one.",
     "They are kept and do not change weights; areas count them twice."),
)  # fmt: skip


def findings(mesh: Mesh, topology: Topology | None = None) -> list[Finding]:
    """Return the unusual properties of `mesh` and their effects; without `topology`, it is computed."""
    counts = topology or inspect(mesh)
    return [Finding(what, means) for what, means in (*_components(mesh, counts), *_surface(counts), *_shape(mesh))]


def _components(mesh: Mesh, counts: Topology) -> Iterator[tuple[str, str]]:
    if counts.components <= 1:
        return
    separate = len(np.unique(connected_components(surface_graph(mesh), directed=False)[1][mesh.faces]))
    means = "Each touches or nearly touches another, so locality and counterparts cross the gaps."
    if separate > 1:
        means = (
            f"Gaps separate {separate:,} groups: with locality, a handle does not move other groups; without "
            "locality, similar parts of all groups move."
        )
    yield f"The surface has {counts.components:,} components that no edge connects.", means


def _surface(counts: Topology) -> Iterator[tuple[str, str]]:
    for name, one, many, what, means in _ODD:
        if number := getattr(counts, name):
            yield what.format(f"{number:,} {one if number == 1 else many}"), means


def _shape(mesh: Mesh) -> Iterator[tuple[str, str]]:
    longest = float(np.max(mesh.extents))
    if longest == 0:
        yield "All vertices have one position.", "Pictures of the shape are empty, so no field can be distilled."
        return
    if float(np.min(mesh.extents)) < _FLAT * longest:
        means = "Its plane is not found as a symmetry plane, and pictures along the plane show almost nothing."
        yield "The shape is flat.", means
    if float(np.abs(mesh.bounds).max()) > _FAR * longest:
        means = "Computations are relative to its center, but files with float32 round its details."
        yield "The shape lies far from the origin for its size.", means
    corners = mesh.vertices[mesh.faces] / longest
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    typical = float(np.median(edges)) / np.linalg.norm(mesh.extents / longest)
    if typical > _COARSE:
        means = "Weights are exact at the vertices, but a face cannot bend: subdivide the mesh before editing."
        yield f"Faces are large: a typical edge is {typical:.0%} of the diagonal of the box.", means
