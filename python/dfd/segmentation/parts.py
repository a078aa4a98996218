"""Find the part of a shape at a place, and divide shapes into parts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64, unit
from dfd.field.field import Field
from dfd.geometry.topology import face_areas
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.segmentation.border import SMALL_COMPONENT, components_of, snapped
from dfd.segmentation.hierarchy import Hierarchy, components_and_borders
from dfd.segmentation.patches import Patches

Level = Literal["smaller", "part", "larger"]
LEAST_RATIO = 1.25  # smallest ratio between the area at a level and the area at the next smaller level
# If no candidate has this saliency (`Hierarchy.saliency`), a handle moves no part. On balls, saliency is at most 0.031.
LEAST_SALIENCY = 0.033
# In the blend band along a part's border, the weights of a `Grip` fall from 1 to 0. At the border, they are 0.5. The
# band's width is at most WIDEST times the diagonal of the bounding box, and at most WIDEST_OF_GIRTH times the girth of
# the part: the mean length of the part's borders. A wider band makes the surface of a moved part less steep. With half
# of both values, the surface of 20 rigs folds by 72° instead of 67° (`python -m bench.quality borders`).
WIDEST, WIDEST_OF_GIRTH = 0.2, 0.5
# BANDS are the possible widths of the blend band, as fractions of its largest width. The band has the smallest width
# that is at least LEAST_WIDTH times the displacement of the border across `Border.direction`. If all are smaller, the
# band has the largest width. At rest, it has the smallest width, at which the weights agree best with labelled parts.
# A band that is not limited by its largest width has a slope of at most 1.5 divided by LEAST_WIDTH.
BANDS, LEAST_WIDTH = (0.25, 0.5, 1.0), 3.0
MOST_POINTS = 64  # largest number of border points whose displacement is measured
# The largest width is multiplied by TRUNK for parts with more than MOST_BORDERS borders per component, such as a trunk.
TRUNK, MOST_BORDERS = 3.0, 1.5


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a shape."""

    mask: Bool = field(repr=False)  # (V,) whether each vertex belongs to the part
    share: float  # area of the part, as a fraction of the area of the surface
    components: int  # number of connected components of the part, without small components
    vertex: int  # in `Parts.part`, the vertex at the given place; in `Parts.cut`, a vertex far from the part's border

    @property
    def vertices(self) -> Int64:
        """Return the vertices (N,) of the part, ascending."""
        return np.flatnonzero(self.mask)


class Border(NamedTuple):
    """The border of the part's connected component at the handle, and the largest width of the blend band there."""

    points: Float64  # (B, 3) positions of some mesh nodes at the border, in mesh units
    direction: Float64  # (3,) unit vector from the border to the middle of the component; 0 for a trunk (`TRUNK`)
    widest: float  # largest width of the blend band, in mesh units

    def band(self, affine: Float64) -> float:
        """Return the width of the blend band, divided by its largest width, for a part that `affine` (3, 4) moves.

        If the border moves farther across `direction`, the band is wider, so that the surface in the band is less
        steep. A motion along `direction` only lengthens the limb, so the band stays narrow.
        """
        moved = self.points @ affine[:, :3].T + affine[:, 3] - self.points
        moved -= (moved @ self.direction)[:, None] * self.direction
        least = LEAST_WIDTH * np.abs(moved).max(initial=0.0)
        return next((band for band in BANDS if band * self.widest >= least), BANDS[-1])


@dataclass(frozen=True, eq=False)
class Grip:
    """The part that a handle moves, as weights."""

    weights: Float32 = field(repr=False)  # (V,) weights of the vertices: 1 in the part, falling to 0 in the blend band
    of_node: Float32 = field(repr=False)  # (N,) weights of the mesh nodes (`dfd.geometry.coarse`)
    # component: (N,) index of the connected component, such as a leg, that contains each mesh node. The value is −1
    # outside the part and on small components.
    component: Int64 = field(repr=False)
    border: Border = field(repr=False)


class Parts:
    """The parts of the shape `mesh`. The first call of a method computes the tree of all parts.

    `features` is a function that returns the features (N, D) of vertices (N,), such as `field.on(mesh).rows`.
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
            "part" is the part that a user most likely means. "smaller" is a part inside that part, and "larger" is a
            part that contains it. Without a smaller or larger part, the result is as for "part".
        alike
            Whether the part includes its counterparts, such as the other legs. False gives one connected component.

        Raises ValueError if `at` is no vertex or point, `level` is unknown, or no face has an area above 0.
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
        """Return the part that a handle at a place moves, or None if there is no part, such as on a ball.

        The result includes all regions that only this part connects to the rest of the shape. `band` is the width of
        the blend band, divided by its largest width.
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
        widest = patches.size * wider * min(WIDEST, tree.girth(chosen) * WIDEST_OF_GIRTH)
        width = band * widest
        # The blend band does not cross gaps between components of the mesh, such as gaps between teeth and lips.
        graph, component = patches.nodes.graph, patches.nodes.component
        row = np.repeat(np.arange(len(side)), np.diff(graph.indptr))
        connected = component[row] == component[graph.indices]
        row, beside, apart = row[connected], graph.indices[connected], graph.data[connected]
        graph = csr_array((apart, (row, beside)), shape=graph.shape)
        ends = np.unique(row[side[row] != side[beside]])
        depth = np.full(len(side), width)
        for inner in (False, True):
            if len(sources := ends[side[ends] != inner]):
                found = dijkstra(graph, indices=sources, min_only=True, limit=width)
                depth[side == inner] = np.minimum(found[side == inner], width)
        within = np.clip(0.5 + np.where(side, depth, -depth) / width, 0.0, 1.0)
        within = within * within * (3.0 - 2.0 * within)
        # If the handle lies in the blend band, the weights are scaled so that the vertex of the handle has weight 1.
        weights = patches.nodes.interpolated(within.astype(np.float32))
        scale = max(weights[vertex], np.float32(0.01))
        component = components_of(patches, inside)
        area = np.bincount(component[inside], patches.area[inside])
        large = (area > SMALL_COMPONENT * area.max()) | (np.arange(len(area)) == component[patch])
        own = component[patch]
        component = np.where(side, np.where(large[component] & inside, component, -1)[patches.of_node], -1)
        points = patches.nodes.center[ends[component[ends] == own]]
        along = np.zeros(3)
        if wider == 1.0 and len(points):
            along = unit((patches.nodes.center[component == own].mean(axis=0) - points.mean(axis=0))[None])[0]
        border = Border(points[:: 1 + len(points) // MOST_POINTS], along, widest)
        of_node = np.minimum(within / scale, 1).astype(np.float32)
        return Grip(np.minimum(weights / scale, 1), of_node, component, border)

    def cut(self) -> list[Part]:
        """Return parts that cover the whole shape, the largest first. Every vertex belongs to exactly one part.

        Counterparts belong to the same part. The parts are those with the clearest borders (`Hierarchy.clarity`).

        Raises ValueError if no face has an area above 0.
        """
        patches, part = self._patches, self._hierarchy.cut_labels()
        masks = part == np.unique(part)[:, None]
        claims = np.array([snapped(patches, inside) for inside in masks])
        # `snapped` moves borders to creases. Nodes that it puts into no part or several parts keep their patch's part.
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
        """Compute the tree of parts, which takes half a second, or several seconds for a million faces."""
        if self._has_surface:
            _ = self._hierarchy

    def _snapped(self, inside: Bool, vertex: int) -> Bool:
        """Move the border of the part `inside` to creases. Return the part's mesh nodes (N,), with that of `vertex`."""
        return snapped(self._patches, inside, int(self._patches.first[self._patches.nodes.of_vertex[vertex]]))

    def _chosen(self, patch: int, level: Level) -> int:
        """Return the tree node (see `Hierarchy`) of the part at a patch."""
        tree = self._hierarchy
        nodes = tree.candidates(patch)
        area = tree.area[nodes]
        clarity = np.array([tree.clarity(node) for node in nodes])
        best = nodes.index(tree.held(patch))
        among = np.array([best])
        if level == "larger":
            among = np.flatnonzero(area > LEAST_RATIO * area[best])
        elif level == "smaller":  # the largest of the smaller tree nodes that are clear (`Hierarchy.clear`)
            among = np.flatnonzero(tree.clear[nodes] & (LEAST_RATIO * area < area[best]))[-1:]
        return nodes[among[clarity[among].argmax()] if len(among) else best]

    def _at_vertices(self, masks: Sequence[Bool]) -> Int64:
        """Interpolate `masks` (N,) to vertices. Return the index of the mask that is largest at each vertex, (V,)."""
        shares = self._patches.nodes.shares(np.array(masks, np.float64))
        best = np.zeros(len(self._mesh.vertices), np.float32)
        label = np.zeros(len(best), np.int64)
        for number, (vertices, share) in enumerate(shares):
            more = share > best[vertices]
            label[vertices[more]], best[vertices[more]] = number, share[more]
        return label

    def _part(self, inside: Bool, mask: Bool, vertex: int) -> Part:
        """Return the part with the patches `inside` (P,) and the vertices `mask` (V,)."""
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
    """Return the parts as a JSON document: a table of the parts, numbered from 1, and the part of every vertex."""
    rows = [
        {"part": number, "share": round(each.share, 4), "components": each.components, "vertex": each.vertex}
        for number, each in enumerate(found, start=1)
    ]
    return {"parts": rows, "part_of_vertex": (1 + np.argmax([part.mask for part in found], axis=0)).tolist()}


def parts(field: Field, mesh: MeshLike) -> Parts:
    """Return the parts of `mesh`, found by the features of `field`. `mesh` can be anything that `dfd.load` reads."""
    shape = as_mesh(mesh)
    return Parts(shape, check.field("parts", field).on(shape).rows)
