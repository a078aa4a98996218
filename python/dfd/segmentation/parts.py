"""Find the part of a shape at a place, and divide shapes into parts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Int64
from dfd.field.field import Field
from dfd.geometry.topology import face_areas, first_at_place
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.segmentation.border import SMALL_COMPONENT, components_of, snapped
from dfd.segmentation.hierarchy import Hierarchy
from dfd.segmentation.patches import Patches

LEAST_RATIO = 1.25  # smallest ratio between the areas of a part and of the next smaller part in `Parts.part`
# At level 0, a handle moves a part only if a candidate has this saliency (`Hierarchy.saliency`). No candidate on a ball
# exceeds 0.031.
LEAST_SALIENCY = 0.033


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


class Parts:
    """The parts of the shape `mesh`. The first call of a method computes the tree of all parts.

    `features` is a function that returns the features (N, D) of vertices (N,), such as `field.on(mesh).rows`.
    """

    def __init__(self, mesh: Mesh, features: Callable[[Int64], Float32]) -> None:
        self._mesh, self._features = mesh, features
        self._latest: tuple[int, list[Bool], int] | None = None  # the patch of the latest call, and its `_ladder`

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
        component, own = _component_of_node(patches, inside, side, patch)
        component[patches.first == patches.first[patches.nodes.of_vertex[vertex]]] = own
        numbers = np.unique(component[component >= 0])
        rank = np.full(component.max() + 2, -1)
        rank[[own, *numbers[numbers != own]]] = np.arange(len(numbers))
        return rank[component]

    def levels(self, at: Any) -> tuple[int, int]:
        """Return the lowest and the highest level of the parts at a place, see `part`."""
        if not self._has_surface:
            return 0, 0
        sets, zero = self._ladder(int(self._patches.of_vertex[self._vertex(at)]))
        return -zero, len(sets) - 1 - zero

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
        sets, zero = self._ladder(patch)
        return sets[min(max(zero + level, 0), len(sets) - 1)]

    def _ladder(self, patch: int) -> tuple[list[Bool], int]:
        """Return the patches (P,) of the parts of all levels at a patch, and the index of level 0 among them."""
        if self._latest is None or self._latest[0] != patch:
            tree, area = self._hierarchy, self._patches.area
            nodes, held = tree.candidates(patch), tree.held(patch)
            number, smaller, larger = nodes.index(held), [tree.closed(held)], [tree.closed(held)]
            for node in nodes[number::-1]:
                for each in (tree.closed(node), tree.inside[node]):
                    if area @ smaller[-1] >= LEAST_RATIO * (area @ each) and not (each & ~smaller[-1]).any():
                        smaller.append(each)
            for each in (tree.closed(node) for node in nodes[number + 1 :]):
                if area @ each >= LEAST_RATIO * (area @ larger[-1]) and not (larger[-1] & ~each).any():
                    larger.append(each)
            self._latest = patch, smaller[:0:-1] + larger, len(smaller) - 1
        return self._latest[1:]

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


def _component_of_node(patches: Patches, inside: Bool, side: Bool, own: int) -> tuple[Int64, int]:
    """Return the component (N,) of each mesh node, without gaps, and the index of the component at patch `own`.

    `inside` (P,) and `side` (N,) are the part's patches and mesh nodes. Small components, and nodes at borders that
    `snapped` moved outwards, have the index of the nearest component. Outside the part, the value is −1.
    """
    component = components_of(patches, inside)
    here = int(component[own])
    area = np.bincount(component[inside], patches.area[inside])
    large = (area > SMALL_COMPONENT * area.max()) | (np.arange(len(area)) == here)
    component = np.where(side, np.where(large[component] & inside, component, -1)[patches.of_node], -1)
    center = patches.nodes.center
    known, lost = np.flatnonzero(component >= 0), np.flatnonzero(side & (component < 0))
    component[lost] = component[known[cKDTree(center[known]).query(center[lost])[1]]] if len(known) else here
    return component[patches.first], here


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
