"""Parts at a click: the part of a shape that holds a place, with its look-alikes or alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.parts.border import snapped
from dfd.parts.hierarchy import Hierarchy
from dfd.parts.patches import Patches

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.geometry.coarse import Nodes
    from dfd.mesh.mesh import Mesh

__all__ = ["Level", "Parts", "parts"]

Level = Literal["smaller", "part", "larger"]
LARGER = 1.25  # times the area is the least by which two levels differ


class Features(Protocol):
    """What gives features of a mesh's vertices: `field.on(mesh)`, or the rows that a session has."""

    def __call__(self, vertices: NDArray[np.int64]) -> NDArray[np.float32]:
        """Features (N, D) of vertices (N,)."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a shape.

    Attributes
    ----------
    mask
        (V,) which vertices belong to it.
    share
        Its part of the surface.
    """

    mask: NDArray[np.bool_]
    share: float

    @property
    def vertices(self) -> NDArray[np.int64]:
        """(N,) its vertices, ascending."""
        return np.flatnonzero(self.mask)


class Parts:
    """The parts of one shape; nothing is computed before the first question.

    Parameters
    ----------
    mesh
        The shape.
    features
        Called with vertices (N,), it gives their features (N, D).
    nodes
        Of the mesh, where somebody has made them.
    """

    def __init__(self, mesh: Mesh, features: Features, *, nodes: Nodes | None = None) -> None:
        self._mesh, self._features, self._given = mesh, features, nodes

    def part(self, at: Any, level: Level = "part", *, alike: bool = True) -> Part:
        """Find the part that holds a place.

        Parameters
        ----------
        at
            A vertex index, or a point (3,) in mesh units, which stands for the vertex nearest to it.
        level
            "part" is what a person would most likely call one, "smaller" lies in it, "larger" holds it. Where nothing
            ends there, they are the same.
        alike
            Whether all that looks alike belongs to it, such as the other legs, or the one connected piece alone.

        Raises
        ------
        ValueError
            If `at` is neither, `level` is unknown, or the mesh has no face with an area.
        """
        check.choice("Parts.part", "level", level, Level)
        patch = int(self._patches.of_vertex[self._vertex(at)])
        inside = self._branch(patch, level)
        if not alike:
            inside = self._piece(inside, patch)
        return self._part(inside)

    def cut(self) -> NDArray[np.int64]:
        """Cut the whole shape: (V,) the part of every vertex, counted from 0, the largest first.

        What looks alike is one part. Of all cuts of the tree it is the one whose parts end most clearly.

        Raises
        ------
        ValueError
            If the mesh has no face with an area.
        """
        patches, tree = self._patches, self._hierarchy
        branches = [tree.branch(node).inside for node in tree.clearest()]
        claims = np.array([snapped(patches, inside) for inside in branches])
        part = np.argmax(branches, axis=0)[patches.of_node]
        part = np.where(claims.sum(axis=0) == 1, claims.argmax(axis=0), part)
        shares = patches.nodes.shares((part == np.arange(len(branches))[:, None]).astype(np.float64))
        best, label = np.zeros(len(self._mesh.vertices), np.float32), np.zeros(len(self._mesh.vertices), np.int64)
        for number, share in enumerate(shares):
            here = share(slice(None))
            label[here > best] = number
            np.maximum(best, here, out=best)
        return label

    def _branch(self, patch: int, level: Level) -> NDArray[np.bool_]:
        tree = self._hierarchy
        branches = [tree.branch(node) for node in tree.holding(patch)]
        area = np.array([branch.area for branch in branches])
        clarity = np.array([branch.clarity for branch in branches])
        best = int(clarity.argmax())
        if level == "part":
            return branches[best].inside
        among = np.flatnonzero(area * LARGER < area[best] if level == "smaller" else area > LARGER * area[best])
        return branches[best if len(among) == 0 else among[clarity[among].argmax()]].inside

    def _piece(self, inside: NDArray[np.bool_], patch: int) -> NDArray[np.bool_]:
        """The connected piece of patches `inside` (P,) that holds one of them."""
        graph = self._patches.borders.graph(np.ones(len(self._patches.borders.pairs)))
        own = np.flatnonzero(inside)
        label = connected_components(graph[own][:, own], directed=False)[1]
        piece = np.zeros_like(inside)
        piece[own[label == label[np.searchsorted(own, patch)]]] = True
        return piece

    def _part(self, inside: NDArray[np.bool_]) -> Part:
        patches = self._patches
        nodes = snapped(patches, inside)
        share, _ = patches.nodes.shares(np.array([nodes, ~nodes], np.float64))
        return Part(share(slice(None)) > 0.5, float(patches.area[inside].sum()))

    def _vertex(self, at: Any) -> int:
        if np.ndim(at) == 0:
            return int(check.vertex_indices("Parts.part", "at", [at], len(self._mesh.vertices))[0])
        point = check.array("Parts.part", "at", at, (3,), dtype=np.float64)
        return int(self._tree.query(point)[1])

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._mesh.vertices)

    @cached_property
    def _patches(self) -> Patches:
        return Patches(self._mesh, self._given)

    @cached_property
    def _hierarchy(self) -> Hierarchy:
        return Hierarchy(self._patches, self._patches.means(self._features))


def parts(field: Field, mesh: Mesh) -> Parts:
    """The parts of `mesh`, whose features `field` gives."""
    return Parts(mesh, field.on(mesh).rows)
