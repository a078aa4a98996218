"""Find unusual properties of a mesh, and describe their effects on weights, poses and other operations."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from dfd.geometry.surface_graph import surface_graph
from dfd.geometry.topology import Topology, inspect
from dfd.mesh.mesh import Mesh

_FLAT = 1e-3  # a shape is flat if its bounding box's shortest side, divided by the longest, is below this
_FAR = 1e4  # a shape is far from the origin if its largest coordinate, divided by the longest side, is above this
_COARSE = 0.1  # faces are large if the median edge length, divided by the bounding box's diagonal, is above this


@dataclass(frozen=True)
class Finding:
    """An unusual property of a mesh."""

    what: str  # the property, as a sentence with numbers
    means: str  # the effect of the property, as a sentence


# Each row has the name of a count in `Topology`, the words after the count (singular, plural), property and effect.
_DEFECTS = (
    ("unreferenced_vertices", "vertex belongs", "vertices belong", "{} to no face.",
     "Pictures do not show such vertices, but they have weights and move."),
    ("boundary_edges", "edge has", "edges have", "The surface is open: {} one face only.",
     "Weights and poses are not affected; distances along the surface go around holes, and volume cannot be kept."),
    ("non_manifold_edges", "edge has", "edges have", "{} more than two faces.",
     "Weights, poses, locality and symmetry are not affected; other programs may refuse the mesh."),
    ("opposed_edges", "edge joins", "edges join", "{} two faces that look to different sides.",
     "Parts and poses are not affected; other programs may not show such faces."),
    ("degenerate_faces", "face has", "faces have", "{} no area.",
     "Such faces are not rendered or measured; their vertices move like all others."),
    ("duplicate_faces", "face repeats", "faces repeat", "{} an earlier one.",
     "Such faces are kept and do not change weights; areas include them twice."),
)  # fmt: skip


def findings(mesh: Mesh, topology: Topology | None = None) -> list[Finding]:
    """Return the unusual properties of `mesh` and their effects. `topology` is computed if it is None."""
    counts = topology or inspect(mesh)
    return [
        Finding(what, means) for what, means in (*_components(mesh, counts), *_surface(mesh, counts), *_shape(mesh))
    ]


def _components(mesh: Mesh, counts: Topology) -> Iterator[tuple[str, str]]:
    if counts.components <= 1:
        return
    separate = len(np.unique(connected_components(surface_graph(mesh), directed=False)[1][mesh.faces]))
    means = "Each touches or nearly touches another one, so locality and counterparts cross the gaps."
    if separate > 1:
        means = (
            f"Gaps separate {separate:,} groups: with locality, a handle moves only its own group; without "
            "locality, it moves similar parts of all groups."
        )
    yield f"The surface has {counts.components:,} components that no edge connects.", means


def _surface(mesh: Mesh, counts: Topology) -> Iterator[tuple[str, str]]:
    for name, one, many, what, means in _DEFECTS:
        if number := getattr(counts, name):
            yield what.format(f"{number:,} {one if number == 1 else many}"), means
    if counts.boundary_edges == counts.opposed_edges == 0:
        corners = (mesh.vertices - mesh.bounds[0])[mesh.faces] / max(float(np.max(mesh.extents)), 1e-300)
        if np.linalg.det(corners).sum() < -1e-9:
            means = "Parts and poses are not affected; other programs may show the shape from inside."
            yield "The surface is closed, and its faces look inward.", means


def _shape(mesh: Mesh) -> Iterator[tuple[str, str]]:
    longest = float(np.max(mesh.extents))
    if longest == 0:
        yield "All vertices have one position.", "Pictures of the shape are empty, so no field can be distilled."
        return
    if float(np.min(mesh.extents)) < _FLAT * longest:
        means = "Its plane is not found as a mirror plane, and pictures along the plane show almost nothing."
        yield "The shape is flat.", means
    if float(np.abs(mesh.bounds).max()) > _FAR * longest:
        means = "Results are computed relative to its center, but files with float32 round small details."
        yield "The shape lies far from the origin for its size.", means
    corners = mesh.vertices[mesh.faces] / longest
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    typical = float(np.median(edges)) / np.linalg.norm(mesh.extents / longest)
    if typical > _COARSE:
        means = "Weights are exact at the vertices, but a face cannot bend: subdivide the mesh before editing."
        yield f"Faces are large: a typical edge is {typical:.0%} of the diagonal of the bounding box.", means
