"""Find the part of a shape at a place, and divide shapes into parts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64, unit
from dfd.field.field import Field
from dfd.geometry.topology import face_areas, first_at_place
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.segmentation.border import SMALL_COMPONENT, components_of, snapped
from dfd.segmentation.hierarchy import Hierarchy, components_and_borders, girth
from dfd.segmentation.patches import Patches

LEAST_RATIO = 1.25  # smallest ratio between the areas of a part and of the next smaller part in `Parts.part`
# At level 0, a handle moves a part only if a candidate has this saliency (`Hierarchy.saliency`). No candidate on a ball
# exceeds 0.031.
LEAST_SALIENCY = 0.033
# In the blend band along a part's border, the weights of a `Grip` fall from 1 to 0. The girth of a part is the mean
# length of its borders. At rest, the width of the band is the smaller of two numbers: REST times the diagonal of the
# bounding box, and REST_OF_GIRTH times the girth. If it is twice as wide, the soft IoU of the weights and labelled
# parts falls from 0.682 to 0.675 (`python -m bench.quality labelled`).
REST, REST_OF_GIRTH = 0.0125, 0.03125
# If the part moves, the width is doubled until it is at least LEAST_WIDTH times the displacement of the border. Outside
# the part, the band extends at most OUTWARD times its width at rest from the border. Inside the part, it extends at
# most INWARD times the largest distance of the part's surface from the border. Twice OUTWARD reduces the mean fold of
# 33 rigs (`python -m bench.quality borders`) from 35° to 32°, but legs then move the whole trunk.
LEAST_WIDTH, OUTWARD, INWARD = 3.0, 8.0, 0.5
NARROWEST = 4.0  # smallest width of a moving band, in widths at rest: narrower bands make a step in lengthened legs
# If a motion lengthens a limb, the band is wider only inside the part, so that the limb is stretched along its length.
# The outermost END girths of the limb, such as a hoof, keep their shape, and so do shorter parts, such as heads. Legs
# can be short, too. So in parts with several components, at most MOST_END of each component's length keeps its shape.
END, MOST_END = 0.5, 0.4
SLANT = 0.18  # tangent of 10°: the legs of a chair are not exactly parallel to the motion that lengthens them
# The weights in and near the band are smoothed along the surface, by STEPS implicit time steps of the heat equation,
# each (SMOOTHING × d)² long. Here, d is the distance of the band's outer end from the border. The steps change weights
# up to MARGIN × d beyond the band, but inside at most INNER_MARGIN times the depth of its inner end beyond this end.
# Without smoothing, the mean fold of the rigs is 48°.
SMOOTHING, STEPS, MARGIN, INNER_MARGIN = 0.6, 2, 1.2, 0.5
MOST_BORDERS = 1.5  # if components have more borders on average, `Border.direction` is 0; an example is a trunk


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


class Band(NamedTuple):
    """The width of a blend band, and the least distance of its inner end from the border, in widths at rest."""

    width: float = 1.0
    inner_end: float = 0.0


AT_REST = Band()


class Border(NamedTuple):
    """The border of the part's connected component at the handle, and the sizes of the blend band there.

    Lengths are in mesh units.
    """

    points: Float64  # (B, 3) positions of the part's mesh nodes (`dfd.geometry.coarse`) at the border
    direction: Float64  # (3,) unit vector from the border to the component's middle; 0 for a trunk (`MOST_BORDERS`)
    rest: float  # width of the blend band at rest
    outward: float  # largest distance of the band's outer end from the border
    inward: float  # largest distance of the band's inner end from the border, except in lengthened limbs
    lengthened: float  # largest distance of the band's inner end from the border in lengthened limbs

    def band(self, affine: Float64) -> Band:
        """Return the blend band for a part that `affine` (3, 4) moves.

        If the border moves farther, the band is wider, so that the surface in the band is less steep. Displacements
        along `direction`, or within 10° of it (`SLANT`), lengthen the limb. These only move the band's inner end.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            moved = self.points @ affine[:, :3].T + affine[:, 3] - self.points
            along = (moved @ self.direction).clip(0.0)
            across = np.linalg.norm(moved - along[:, None] * self.direction, axis=1) - SLANT * along
            needed = LEAST_WIDTH * np.array([across.max(initial=0.0), along.max(initial=0.0)])
        widths = np.fmin(needed, (self.outward + self.inward, self.lengthened))  # after an overflow, the largest widths
        width, inner_end = 2.0 ** np.ceil(np.log2(np.maximum(widths / self.rest, NARROWEST)))
        return Band(float(width), float(inner_end) if inner_end > NARROWEST else 0.0)


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

    def part(self, at: Any, level: int = 0, *, alike: bool = True) -> Part:
        """Return the part at a place.

        Parameters
        ----------
        at
            A vertex index, or a point (3,) in mesh units, which stands for the nearest vertex.
        level
            0 is the part that a user most likely means. −1, −2, … are smaller parts inside it, and 1, 2, … are larger
            parts that contain it. At levels from 0 up, the part includes regions that would be cut off without it, such
            as a leg's hoof. A level beyond the smallest or the largest part stands for that part.
        alike
            Whether the part includes its counterparts, such as the other legs. False gives one connected component.

        Raises ValueError if `at` is no vertex or point, `level` is no whole number, or no face has an area above 0.
        """
        level = check.whole("Parts.part", "level", level)
        vertex = self._vertex(at)
        patch = int(self._patches.of_vertex[vertex])
        inside = self._inside(patch, level)
        if not alike:
            component = components_of(self._patches, inside)
            inside = component == component[patch]
        nodes = self._snapped(inside, vertex)
        mask = self._at_vertices([~nodes, nodes]) == 1
        first = first_at_place(self._mesh)
        mask |= first == first[vertex]  # the interpolation can exclude the vertex from a small part
        return self._part(inside, mask, vertex)

    def grip(self, at: Any, level: int = 0, band: Band = AT_REST) -> Grip | None:
        """Return the part that a handle at a place moves, or None if there is no part, such as level 0 on a ball.

        `level` is as in `part`.
        """
        vertex = self._vertex(at)
        if not self._has_surface:
            return None
        tree, patches = self._hierarchy, self._patches
        patch = int(patches.of_vertex[vertex])
        inside = self._inside(patch, level)
        unclear = max(map(tree.saliency, tree.candidates(patch))) < LEAST_SALIENCY
        if inside.all() or (unclear and np.array_equal(inside, self._inside(patch, 0))):
            return None
        side = self._snapped(inside, vertex)
        depth, ends = _depth(patches, side)
        component, nearest, own = _component_of_node(patches, inside, side, patch)
        components, borders = components_and_borders(patches, inside)
        around = patches.size * girth(patches, inside, borders)
        rest = min(patches.size * REST, around * REST_OF_GIRTH)
        # The band ends nearer to the border in components that are shorter than the one at the handle.
        deepest = np.zeros(max(own, nearest.max()) + 1)
        np.maximum.at(deepest, nearest[side], np.where(np.isfinite(depth), depth, 0.0)[side])
        inward = np.maximum(INWARD * deepest, rest / 2)
        lengthened = deepest - np.minimum(END * around, deepest * (MOST_END if len(components) > 1 else 1.0))
        center = patches.nodes.center
        points, direction = center[ends[nearest[ends] == own]], np.zeros(3)
        if borders <= MOST_BORDERS * len(components) and len(points):
            direction = unit((center[component == own].mean(axis=0) - points.mean(axis=0))[None])[0]
        border = Border(points, direction, rest, OUTWARD * rest, float(inward[own]), float(lengthened[own]))
        within = _blended(patches, depth, border, band, inward[nearest], lengthened[nearest])
        # If the handle lies in the blend band, the weights are scaled so that the vertex of the handle has weight 1.
        weights = patches.nodes.interpolated(within.astype(np.float32))
        scale = max(weights[vertex], np.float32(0.01))
        of_node = np.minimum(within / scale, 1).astype(np.float32)
        return Grip(np.minimum(weights / scale, 1), of_node, component, border)

    def components(self, at: Any, level: int = 0) -> Int64 | None:
        """Return the component of the part at a vertex that contains each mesh node, (N,).

        0 is the component at the vertex, −1 is outside the part. The result is None if no part was found, such as level
        0 on a ball. `level` is as in `part`.
        """
        vertex = self._vertex(at)
        if not self._has_surface:
            return None
        tree, patches = self._hierarchy, self._patches
        patch = int(patches.of_vertex[vertex])
        inside = self._inside(patch, level)
        unclear = max(map(tree.saliency, tree.candidates(patch))) < LEAST_SALIENCY
        if inside.all() or (unclear and np.array_equal(inside, self._inside(patch, 0))):
            return None
        side = self._snapped(inside, vertex)
        _, nearest, own = _component_of_node(patches, inside, side, patch)
        nearest = np.where(side, nearest, -1)[patches.first]
        # Number the components by the area of their first appearance, with the component at the vertex first.
        numbers = np.unique(nearest[nearest >= 0])
        order = np.concatenate([[own], numbers[numbers != own]])
        rank = np.full(nearest.max() + 1, -1)
        rank[order] = np.arange(len(order))
        return np.where(nearest >= 0, rank[nearest], -1)

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
        """Move the border of the part `inside` to creases. Return its nodes (N,); that of `vertex` is one of them."""
        return snapped(self._patches, inside, int(self._patches.first[self._patches.nodes.of_vertex[vertex]]))

    def _inside(self, patch: int, level: int) -> Bool:
        """Return the patches (P,) of the part at a patch. `level` is as in `part`."""
        tree, area = self._hierarchy, self._patches.area
        nodes, held = tree.candidates(patch), tree.held(patch)
        found, number = tree.closed(held), nodes.index(held)
        if level == 0:
            return found
        sets = [tree.closed(node) for node in nodes[number + 1 :]]
        if level < 0:
            sets = [inside for node in nodes[number::-1] for inside in (tree.closed(node), tree.inside[node])]
        for each in sets:
            small, large = (each, found) if level < 0 else (found, each)
            if level and area @ large >= LEAST_RATIO * (area @ small) and not (small & ~large).any():
                found, level = each, level - np.sign(level)
        return found

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


def _depth(patches: Patches, side: Bool) -> tuple[Float64, Int64]:
    """Return the signed distance (N,) of each mesh node from the border of the part `side` (N,), in mesh units.

    The distances are along the surface, positive in the part, and negative outside. They do not cross gaps between
    components of the mesh, such as gaps between teeth and lips. They are infinite for nodes without a path to the
    border. Also return the nodes (E,) beside the border, on both sides.
    """
    graph, of_mesh = patches.nodes.graph, patches.nodes.component
    row = np.repeat(np.arange(len(side)), np.diff(graph.indptr))
    connected = of_mesh[row] == of_mesh[graph.indices]
    row, beside, apart = row[connected], graph.indices[connected], graph.data[connected]
    ends = np.unique(row[side[row] != side[beside]])
    graph = csr_array((apart, (row, beside)), shape=graph.shape)
    depth = np.where(side, np.inf, -np.inf)
    for inner in (False, True):
        if len(sources := ends[side[ends] != inner]):
            found = dijkstra(graph, indices=sources, min_only=True)
            depth = np.where(side == inner, found if inner else -found, depth)
    return depth, ends


def _component_of_node(patches: Patches, inside: Bool, side: Bool, own: int) -> tuple[Int64, Int64, int]:
    """Return `Grip.component` (N,), a copy of it without gaps (N,), and the index of the component at patch `own`.

    `inside` (P,) and `side` (N,) are the part's patches and mesh nodes. In the copy, nodes of the part at borders that
    `snapped` moved outwards have the index of the nearest component.
    """
    component = components_of(patches, inside)
    here = int(component[own])
    area = np.bincount(component[inside], patches.area[inside])
    large = (area > SMALL_COMPONENT * area.max()) | (np.arange(len(area)) == here)
    component = np.where(side, np.where(large[component] & inside, component, -1)[patches.of_node], -1)
    center, nearest = patches.nodes.center, component.copy()
    known, lost = np.flatnonzero(component >= 0), np.flatnonzero(side & (component < 0))
    nearest[lost] = component[known[cKDTree(center[known]).query(center[lost])[1]]] if len(known) else here
    return component, nearest, here


def _blended(
    patches: Patches, depth: Float64, border: Border, band: Band, inward: Float64, lengthened: Float64
) -> Float64:
    """Return weights (N,) of mesh nodes that fall from 1 to 0 in the blend band.

    `depth` (N,) is the result of `_depth`. `inward` and `lengthened` (N,) are the attributes of `Border` for the
    component that contains each node.
    """
    outward = min(band.width * border.rest / 2, border.outward)
    rest_of_width, inner_end = band.width * border.rest - outward, band.inner_end * border.rest
    at_border = outward / (outward + max(min(rest_of_width, border.inward), min(inner_end, border.lengthened)))
    inward = np.maximum(np.minimum(rest_of_width, inward), np.minimum(inner_end, lengthened))
    weights = np.where(depth < 0, at_border * (1 + depth / outward), at_border + (1 - at_border) * depth / inward)
    np.clip(weights, 0.0, 1.0, out=weights)
    beyond, area = MARGIN * outward, patches.node_area
    inner = inward + np.minimum(beyond, INNER_MARGIN * inward)
    free = np.flatnonzero((depth > -outward - beyond) & (depth < inner) & (area > 0.0))
    if len(free):
        borders, time = patches.node_borders, (SMOOTHING * outward / patches.size) ** 2
        conductance = borders.graph(time * borders.length / borders.apart)[free]
        among = conductance[:, free]
        laplacian = diags_array(np.asarray(conductance.sum(axis=1)).ravel()) - among
        fixed = conductance @ weights - among @ weights[free]
        solve = splu((diags_array(area[free]) + laplacian).tocsc()).solve
        for _ in range(STEPS):
            weights[free] = solve(area[free] * weights[free] + fixed)
    return np.asarray(weights[patches.first], np.float64)


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
