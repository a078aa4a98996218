"""Parts at a click: the part of a shape that holds a place, with its look-alikes or alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Int64
from dfd.field.field import Field
from dfd.geometry.topology import face_areas
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.segmentation.border import CRUMB, closed, pieces_of, snapped
from dfd.segmentation.hierarchy import Hierarchy, pieces_and_borders
from dfd.segmentation.patches import Patches

Level = Literal["smaller", "part", "larger"]
LARGER = 1.25  # times the area is the least by which two levels differ
LEAST_HOLDABLE = 0.033  # what chance finds on a ball has up to 0.031, parts that people name 0.08 to 2
# Of the seam in which a grip fades: width in diagonals of the box, and of the way around a limb; how much lies
# beyond the border. Most lies within: what moves beside a part is what people mind the most.
SEAM, THICKNESS, BEYOND = 0.05, 0.25, 0.3
# So many times wider is that of a part with more borders than this for each of its pieces: a trunk is no limb that
# moves by itself, and pulled at its belly it would tear from all that is around it.
TRUNK, MOST_OF_LIMBS = 3.0, 1.5


class Features(Protocol):
    """What gives features of a mesh's vertices: `field.on(mesh)`, or the rows that a session has."""

    def __call__(self, vertices: Int64) -> Float32:
        """Features (N, D) of vertices (N,)."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a shape."""

    mask: Bool = field(repr=False)  # (V,) which vertices belong to it
    share: float  # its part of the surface
    pieces: int  # how many connected pieces it has, besides crumbs
    vertex: int  # one that lies well in it, or the one that was asked for

    @property
    def vertices(self) -> Int64:
        """(N,) its vertices, ascending."""
        return np.flatnonzero(self.mask)


@dataclass(frozen=True, eq=False)
class Grip:
    """What is held of a shape at a place."""

    # weights: (V,) how much of the part that holds the place vertices are: 1 in it, 0 beyond it, falling smoothly over
    # its seam
    weights: Float32 = field(repr=False)
    # pieces: (V,) which connected piece of it each vertex is on, such as one leg of all, counted from 0; −1 for
    # crumbs, and beyond
    pieces: Int64 = field(repr=False)


class Parts:
    """The parts of one shape; nothing is computed before the first question.

    Parameters
    ----------
    mesh
        The shape.
    features
        Called with vertices (N,), it gives their features (N, D).
    """

    def __init__(self, mesh: Mesh, features: Features) -> None:
        self._mesh, self._features = mesh, features

    def __repr__(self) -> str:
        """Say of what."""
        return f"Parts({self._mesh!r})"

    def part(self, at: Any, level: Level = "part", *, alike: bool = True) -> Part:
        """Find the part that holds a place.

        Parameters
        ----------
        at
            A vertex index, or a point (3,) in mesh units, which stands for the vertex nearest to it.
        level
            "part" is the one that people most likely mean there, "smaller" lies in it, "larger" holds it. Where nothing
            ends there, they are the same.
        alike
            Whether all that looks alike belongs to it, such as the other legs, or the one connected piece alone.

        Raises ValueError if `at` is neither, `level` is unknown, or the mesh has no face with an area.
        """
        check.choice("Parts.part", "level", level, Level)
        vertex = self._vertex(at)
        patch = int(self._patches.of_vertex[vertex])
        inside = self._hierarchy.branches[self._chosen(patch, level)].inside
        if not alike:
            piece = pieces_of(self._patches, inside)
            inside = piece == piece[patch]
        nodes = self._snapped(inside, vertex)
        return self._part(inside, self._carried([~nodes, nodes]) == 1, vertex)

    def grip(self, at: Any) -> Grip | None:
        """What is held at a place: the part, as in `part`, with what hangs on the rest through it alone.

        None where no part ends, such as on a ball.
        """
        vertex = self._vertex(at)
        if not self._has_surface:
            return None
        tree, patches = self._hierarchy, self._patches
        chosen = self._chosen(int(patches.of_vertex[vertex]), "part")
        inside = closed(patches, tree.branches[chosen].inside)
        if inside.all() or tree.holdable(chosen) < LEAST_HOLDABLE:
            return None
        side = self._snapped(inside, vertex)
        width = patches.size * self._seam(chosen, inside)
        # A gap between components is a border by itself: nothing passes over from tooth to lip.
        graph, component = patches.nodes.graph, patches.nodes.component
        row = np.repeat(np.arange(len(side)), np.diff(graph.indptr))
        whole = component[row] == component[graph.indices]
        row, beside, apart = row[whole], graph.indices[whole], graph.data[whole]
        graph = csr_array((apart, (row, beside)), shape=graph.shape)
        ends = np.unique(row[side[row] != side[beside]])
        depth = np.full(len(side), width)
        for inner in (False, True):
            if len(sources := ends[side[ends] != inner]):
                found = dijkstra(graph, indices=sources, min_only=True, limit=width)
                depth[side == inner] = np.minimum(found[side == inner], width)
        within = np.clip(BEYOND + np.where(side, depth, -depth) / width, 0.0, 1.0)
        within = within * within * (3.0 - 2.0 * within)
        held = np.asarray(patches.nodes.shares(np.stack([1.0 - within, within]))[1](slice(None)), np.float32)
        # Who takes hold of the seam itself holds it whole, and less of it is left to fade.
        weights = np.minimum(held / max(held[vertex], np.float32(0.01)), 1.0)
        pieces = pieces_of(patches, inside)
        area = np.bincount(pieces[inside], patches.area[inside])
        large = (area > CRUMB * area.max()) | (np.arange(len(area)) == pieces[patches.of_vertex[vertex]])
        pieces = np.where(large[pieces] & inside, pieces, -1)
        return Grip(
            np.asarray(weights, np.float32), np.where(side, pieces[patches.of_node], -1)[patches.nodes.of_vertex]
        )

    def grips(self) -> Int64:
        """(V,) numbers from 0: at vertices of one number `grip` is the same, but for a seam that snaps to them."""
        chosen = [self._chosen(patch, "part") for patch in range(self._patches.borders.count)]
        return np.asarray(np.unique(chosen, return_inverse=True)[1], np.int64)[self._patches.of_vertex]

    def cut(self) -> list[Part]:
        """Cut the whole shape into parts, the largest first; every vertex belongs to one.

        What looks alike is one part. Of all cuts of the tree it is the one whose parts end most clearly.

        Raises ValueError if the mesh has no face with an area.
        """
        patches, part = self._patches, self._hierarchy.shown()
        branches = part == np.unique(part)[:, None]
        claims = np.array([snapped(patches, inside) for inside in branches])
        # What several claim, or none, stays with the part that its patch is of.
        of_node = np.where(claims.sum(axis=0) == 1, claims.argmax(axis=0), branches.argmax(axis=0)[patches.of_node])
        sides = [of_node == number for number in range(len(branches))]
        label = self._carried(sides)
        found = [
            self._part(inside, label == number, self._middle(inside))
            for number, inside in enumerate(branches)
            if (label == number).any()
        ]
        return sorted(found, key=lambda each: -each.share)

    def prepare(self) -> None:
        """Do now what the first question would have to wait for: half a second, and seconds for a million faces."""
        if self._has_surface:
            _ = self._hierarchy

    def _seam(self, chosen: int, inside: Bool) -> float:
        """Width of the seam around a part, in diagonals of the box."""
        pieces, borders = pieces_and_borders(self._patches, inside)
        wider = TRUNK if borders > MOST_OF_LIMBS * len(pieces) else 1.0
        return wider * min(SEAM, self._hierarchy.around(chosen) * THICKNESS)

    def _snapped(self, inside: Bool, vertex: int) -> Bool:
        """(N,) which nodes belong to the part of patches `inside` (P,) that holds a vertex."""
        return snapped(self._patches, inside, int(self._patches.twin[self._patches.nodes.of_vertex[vertex]]))

    def _chosen(self, patch: int, level: Level) -> int:
        """The node of the tree that is the part at a patch."""
        tree = self._hierarchy
        nodes = tree.holding(patch)
        area = np.array([tree.branches[node].area for node in nodes])
        clarity = np.array([tree.clarity(node) for node in nodes])
        best = nodes.index(tree.meant(nodes))
        among = np.array([best])
        if level == "larger":
            among = np.flatnonzero(area > LARGER * area[best])
        elif level == "smaller":  # the clearest cut of the part itself
            among = np.flatnonzero(tree.clear[nodes] & (LARGER * area < area[best]))[-1:]
        chosen = among[clarity[among].argmax()] if len(among) else best
        return nodes[chosen]

    def _carried(self, sides: Sequence[Bool]) -> Int64:
        """(V,) which of `sides`, of the nodes (N,), most of the nodes around each vertex are on."""
        shares = self._patches.nodes.shares(np.array(sides, np.float64))
        best = np.zeros(len(self._mesh.vertices), np.float32)
        label = np.zeros(len(best), np.int64)
        for number, share in enumerate(shares):
            here = share(slice(None))
            label[here > best] = number
            np.maximum(best, here, out=best)
        return label

    def _part(self, inside: Bool, mask: Bool, vertex: int) -> Part:
        piece, area = pieces_of(self._patches, inside)[inside], self._patches.area[inside]
        sizes = np.bincount(piece, area)
        return Part(mask, float(area.sum()), int((sizes > CRUMB * sizes.max()).sum()), vertex)

    def _middle(self, inside: Bool) -> int:
        """A vertex of the patch of `inside` (P,) that lies the farthest from where the part ends."""
        borders = self._patches.borders
        ends = np.unique(borders.pairs[np.not_equal(*inside[borders.pairs.T])])
        depth = (
            dijkstra(borders.graph(borders.apart), indices=ends, min_only=True) if len(ends) else np.zeros(len(inside))
        )
        depth = np.where(inside & np.isfinite(depth), depth, -1.0)
        return int(np.flatnonzero(self._patches.of_vertex == depth.argmax())[0])

    def _vertex(self, at: Any) -> int:
        if np.ndim(at) == 0:
            return int(check.vertex_indices("Parts.part", "at", [at], len(self._mesh.vertices))[0])
        point = check.array("Parts.part", "at", at, (3,), dtype=np.float64)
        return int(self._tree.query(point)[1])

    @cached_property
    def _has_surface(self) -> bool:
        return bool(face_areas(self._mesh.vertices, self._mesh.faces).any())

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._mesh.vertices)

    @cached_property
    def _patches(self) -> Patches:
        return Patches(self._mesh)

    @cached_property
    def _hierarchy(self) -> Hierarchy:
        return Hierarchy(self._patches, self._patches.means(self._features))


def cut_document(found: Sequence[Part]) -> dict[str, Any]:
    """What JSON says of a shape's parts: a row for each, numbered from 1, and the part of every vertex."""
    rows = [
        {"part": number, "share": round(each.share, 4), "pieces": each.pieces, "vertex": each.vertex}
        for number, each in enumerate(found, start=1)
    ]
    return {"parts": rows, "part_of_vertex": (1 + np.argmax([part.mask for part in found], axis=0)).tolist()}


def parts(field: Field, mesh: MeshLike) -> Parts:
    """Find the parts of `mesh`, or of whatever `dfd.load` makes one of, by the features that `field` gives there."""
    shape = as_mesh(mesh)
    return Parts(shape, check.field("parts", field).on(shape).rows)
