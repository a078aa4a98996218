"""Find the part of a shape at a place, with or without its counterparts, and cut shapes into parts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.field.field import Field
from dfd.geometry.topology import face_areas
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.segmentation.border import SMALL_COMPONENT, components_of, snapped
from dfd.segmentation.hierarchy import Hierarchy, components_and_borders
from dfd.segmentation.patches import Patches

Level = Literal["smaller", "part", "larger"]
LARGER = 1.25  # least ratio of the areas of two levels
# Smallest saliency of a part. On a ball, chance gives up to 0.031. Parts that people name have 0.08 to 2.
LEAST_SALIENCY = 0.033
# In the blend band, the weights of a grip fall from 1 to 0. The border of the part, with weight 0.5, is the middle of
# the band. The largest width is the smaller of WIDEST times the diagonal of the box and OF_GIRTH times the girth of the
# limb. With half of both, borders are steeper: `python -m bench.quality borders` finds a fold of 89° instead of 68° on
# 20 rigs.
WIDEST, OF_GIRTH = 0.2, 0.5
# Widths of the blend band, relative to the largest one. At rest, the smallest one has a soft IoU of 0.678 with 19
# labelled meshes; half of the largest width has 0.663.
BANDS = (0.25, 0.5, 1.0)
LEAST_WIDTH = 2.0  # least width of a band that is not the widest, relative to the displacement of the border
MOST_POINTS = 64  # largest number of border points whose displacement is measured
# Parts with more than MOST_BORDERS borders per component, such as a trunk, have a blend band TRUNK times as wide.
TRUNK, MOST_BORDERS = 3.0, 1.5


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a shape."""

    mask: Bool = field(repr=False)  # (V,) whether a vertex belongs to the part
    share: float  # its share of the area of the surface
    components: int  # the number of its connected components, without small components
    vertex: int  # a vertex far from its border, or the vertex of the request

    @property
    def vertices(self) -> Int64:
        """Return the vertices (N,) of the part, ascending."""
        return np.flatnonzero(self.mask)


class Border(NamedTuple):
    """The border of the component at a handle, and the largest width of the blend band there."""

    points: Float64  # (B, 3) positions of some of its nodes, mesh units
    widest: float  # mesh units

    def band(self, affine: Float64) -> float:
        """Return the width of the band, relative to the largest one, for a part that `affine` (3, 4) transforms.

        The further the border moves, the wider is the band, so that the surface there is not steep.
        """
        moved = self.points @ affine[:, :3].T + affine[:, 3] - self.points
        least = LEAST_WIDTH * np.abs(moved).max(initial=0.0)
        return next((band for band in BANDS if band * self.widest >= least), BANDS[-1])


NO_BORDER = Border(np.empty((0, 3)), 0.0)


@dataclass(frozen=True, eq=False)
class Grip:
    """The part that a handle holds, as weights."""

    weights: Float32 = field(repr=False)  # (V,) 1 inside the part, 0 outside, and smooth in the blend band
    of_node: Float32 = field(repr=False)  # (N,) the weights at the mesh's nodes, see `dfd.geometry.coarse`
    # (N,) the connected component of each node, such as one of four legs, counted from 0. −1 stands for nodes outside
    # the part and on small components.
    component: Int64 = field(repr=False)
    border: Border = field(default=NO_BORDER, repr=False)


class Parts:
    """The parts of the shape `mesh`, computed for the first request.

    `features` returns the features (N, D) of vertices (N,), such as `field.on(mesh).rows`.
    """

    def __init__(self, mesh: Mesh, features: Callable[[Int64], Float32]) -> None:
        self._mesh, self._features = mesh, features

    def __repr__(self) -> str:
        return f"Parts({self._mesh!r})"

    def part(self, at: Any, level: Level = "part", *, alike: bool = True) -> Part:
        """Return the part at a place.

        Parameters
        ----------
        at
            A vertex index, or a point (3,) in mesh units, which stands for the nearest vertex.
        level
            "part" is the part that people most likely mean. "smaller" is a part inside it, and "larger" is a part that
            contains it. If there is no such part, "smaller" and "larger" equal "part".
        alike
            Whether counterparts belong to the part, such as the other legs. False gives one connected component.

        Raises ValueError if `at` is no vertex or point, `level` is unknown, or the mesh has no face with an area.
        """
        check.choice("Parts.part", "level", level, Level)
        vertex = self._vertex(at)
        patch = int(self._patches.of_vertex[vertex])
        inside = self._hierarchy.inside[self._chosen(patch, level)]
        if not alike:
            component = components_of(self._patches, inside)
            inside = component == component[patch]
        nodes = self._snapped(inside, vertex)
        return self._part(inside, self._at_vertices([~nodes, nodes]) == 1, vertex)

    def grip(self, at: Any, band: float = BANDS[0]) -> Grip | None:
        """Return the part that a handle at a place holds, with all regions that only this part connects to the rest.

        `band` is the width of the blend band, relative to the largest one. Return None if there is no part, such as on
        a ball.
        """
        vertex = self._vertex(at)
        if not self._has_surface:
            return None
        tree, patches = self._hierarchy, self._patches
        patch = int(patches.of_vertex[vertex])
        chosen = self._chosen(patch, "part")
        inside = tree.closed(chosen)
        if inside.all() or max(map(tree.saliency, tree.candidates(patch))) < LEAST_SALIENCY:
            return None
        side = self._snapped(inside, vertex)
        components, borders = components_and_borders(patches, inside)
        wider = TRUNK if borders > MOST_BORDERS * len(components) else 1.0
        widest = patches.size * wider * min(WIDEST, tree.girth(chosen) * OF_GIRTH)
        width = band * widest
        # The blend band does not cross gaps between components of the mesh, such as between teeth and lips.
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
        within = np.clip(0.5 + np.where(side, depth, -depth) / width, 0.0, 1.0)
        within = within * within * (3.0 - 2.0 * within)
        # If the handle lies in the blend band, the weights are scaled so that its own vertex has weight 1.
        held = patches.nodes.interpolated(within.astype(np.float32))
        whole = max(held[vertex], np.float32(0.01))
        component = components_of(patches, inside)
        area = np.bincount(component[inside], patches.area[inside])
        large = (area > SMALL_COMPONENT * area.max()) | (np.arange(len(area)) == component[patch])
        own = component[patch]
        component = np.where(side, np.where(large[component] & inside, component, -1)[patches.of_node], -1)
        points = patches.nodes.center[ends[component[ends] == own]]
        border = Border(points[:: 1 + len(points) // MOST_POINTS], widest)
        return Grip(np.minimum(held / whole, 1), np.minimum(within / whole, 1).astype(np.float32), component, border)

    def cut(self) -> list[Part]:
        """Return parts that cover the whole shape, the largest first; every vertex belongs to exactly one.

        Counterparts form one part. The cut is the one with the clearest borders.

        Raises ValueError if the mesh has no face with an area.
        """
        patches, part = self._patches, self._hierarchy.cut_labels()
        masks = part == np.unique(part)[:, None]
        claims = np.array([snapped(patches, inside) for inside in masks])
        # If no part or several parts contain a node after snapping, the node keeps the part of its patch.
        of_node = np.where(claims.sum(axis=0) == 1, claims.argmax(axis=0), masks.argmax(axis=0)[patches.of_node])
        label = self._at_vertices([of_node == number for number in range(len(masks))])
        found = []
        for number, inside in enumerate(masks):
            if (label == number).any():
                depth = patches.borders.depth(inside)
                deepest = np.where(inside & np.isfinite(depth), depth, -1.0).argmax()
                found.append(self._part(inside, label == number, int((patches.of_vertex == deepest).argmax())))
        return sorted(found, key=lambda each: -each.share)

    def prepare(self) -> None:
        """Compute the tree of parts, which takes half a second, and seconds for a million faces."""
        if self._has_surface:
            _ = self._hierarchy

    def _snapped(self, inside: Bool, vertex: int) -> Bool:
        """Return (N,) the nodes of the part of patches `inside` (P,), which always has the node of `vertex`."""
        return snapped(self._patches, inside, int(self._patches.first[self._patches.nodes.of_vertex[vertex]]))

    def _chosen(self, patch: int, level: Level) -> int:
        """Return the tree node of the part at a patch."""
        tree = self._hierarchy
        nodes = tree.candidates(patch)
        area = tree.area[nodes]
        clarity = np.array([tree.clarity(node) for node in nodes])
        best = nodes.index(tree.held(patch))
        among = np.array([best])
        if level == "larger":
            among = np.flatnonzero(area > LARGER * area[best])
        elif level == "smaller":  # the largest node inside that is clearer than each cut of it
            among = np.flatnonzero(tree.clear[nodes] & (LARGER * area < area[best]))[-1:]
        return nodes[among[clarity[among].argmax()] if len(among) else best]

    def _at_vertices(self, sides: Sequence[Bool]) -> Int64:
        """Return (V,) the index of the mask in `sides`, (N,) each, with the largest interpolated share at a vertex."""
        shares = self._patches.nodes.shares(np.array(sides, np.float64))
        best = np.zeros(len(self._mesh.vertices), np.float32)
        label = np.zeros(len(best), np.int64)
        for number, (vertices, share) in enumerate(shares):
            more = share > best[vertices]
            label[vertices[more]], best[vertices[more]] = number, share[more]
        return label

    def _part(self, inside: Bool, mask: Bool, vertex: int) -> Part:
        """Return the part of patches `inside` (P,) and vertices `mask` (V,)."""
        component, area = components_of(self._patches, inside)[inside], self._patches.area[inside]
        sizes = np.bincount(component, area)
        return Part(mask, float(area.sum()), int((sizes > SMALL_COMPONENT * sizes.max()).sum()), vertex)

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
    """Return the parts as a JSON document: a row for each part, numbered from 1, and the part of every vertex."""
    rows = [
        {"part": number, "share": round(each.share, 4), "components": each.components, "vertex": each.vertex}
        for number, each in enumerate(found, start=1)
    ]
    return {"parts": rows, "part_of_vertex": (1 + np.argmax([part.mask for part in found], axis=0)).tolist()}


def parts(field: Field, mesh: MeshLike) -> Parts:
    """Return the parts of `mesh`, or of anything that `dfd.load` reads, by the features of `field`."""
    shape = as_mesh(mesh)
    return Parts(shape, check.field("parts", field).on(shape).rows)
