"""Unusual properties of a mesh, and their effect on each control."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from dfd.geometry.surface_graph import surface_graph
from dfd.geometry.topology import Topology, inspect
from dfd.mesh.mesh import Mesh

_FLAT = 1e-3  # thickness over the longest side
# Distance from the origin over the longest side. Above it, float32 resolves less than a thousandth of the shape.
_FAR = 1e4
_COARSE = 0.1  # median edge over the diagonal of the box


@dataclass(frozen=True)
class Finding:
    """An unusual property of a mesh."""

    what: str  # a sentence with the numbers
    means: str  # a sentence that names the affected controls and the effect


# Each row: a count of `Topology`, its name in singular and plural, the finding, and its consequence.
_ODD = (
    ("unreferenced_vertices", "vertex is", "vertices are", "{} of no face.",
     "No picture shows them; they take weights by where they are, and move along."),
    ("boundary_edges", "edge has", "edges have", "The surface is open: {} one face only.",
     "Weights and poses do not mind; locality goes around holes, and there is no volume to keep."),
    ("non_manifold_edges", "edge has", "edges have", "{} more than two faces.",
     "Weights, poses, locality and symmetry do not mind; other programs may refuse the mesh."),
    ("degenerate_faces", "face has", "faces have", "{} no area.",
     "Nothing is seen or measured on them; their corners move with all others."),
    ("duplicate_faces", "face repeats", "faces repeat", "{} an earlier one.",
     "They are kept and change no weight; areas count them twice."),
)  # fmt: skip


def findings(mesh: Mesh, topology: Topology | None = None) -> list[Finding]:
    """List the unusual properties of `mesh` and their effect on each control; count `topology` if None."""
    counts = topology or inspect(mesh)
    return [Finding(what, means) for what, means in (*_components(mesh, counts), *_surface(counts), *_shape(mesh))]


def _components(mesh: Mesh, counts: Topology) -> Iterator[tuple[str, str]]:
    if counts.components <= 1:
        return
    separate = len(np.unique(connected_components(surface_graph(mesh), directed=False)[1][mesh.faces]))
    means = "All touch or nearly touch another, so locality and instances reach across the gaps."
    if separate > 1:
        means = (
            f"Gaps leave {separate:,} groups apart: with locality a handle does not reach another group, unless "
            "separate groups are given a distance; without it alike parts follow in every group."
        )
    yield f"The surface has {counts.components:,} components that no edge connects.", means


def _surface(counts: Topology) -> Iterator[tuple[str, str]]:
    for name, one, many, what, means in _ODD:
        if number := getattr(counts, name):
            yield what.format(f"{number:,} {one if number == 1 else many}"), means


def _shape(mesh: Mesh) -> Iterator[tuple[str, str]]:
    longest = float(np.max(mesh.extents))
    if longest == 0:
        yield "All vertices are one point.", "There is nothing to see: no field can be distilled."
        return
    if float(np.min(mesh.extents)) < _FLAT * longest:
        means = "Its own plane is not offered for symmetry, and views along it show next to nothing."
        yield "The shape is flat.", means
    if float(np.abs(mesh.bounds).max()) > _FAR * longest:
        means = "Computing is done around its middle, but files that hold float32 keep its details only roughly."
        yield "The shape lies far from the origin for its size.", means
    corners = mesh.vertices[mesh.faces] / longest
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    typical = float(np.median(edges)) / np.linalg.norm(mesh.extents / longest)
    if typical > _COARSE:
        means = "Weights are exact at the vertices, but what bends between them stays flat: subdivide before editing."
        yield f"Faces are large: a typical edge is {typical:.0%} of the diagonal of the box.", means
