"""Find the part of a shape at a place, and divide shapes into parts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.kept import Kept
from dfd.common.linear_algebra import Bool, Float32, Int64
from dfd.field.field import Field
from dfd.geometry.topology import face_areas, first_at_place
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.segmentation.alike import POSSIBLE, Alike
from dfd.segmentation.border import snapped
from dfd.segmentation.choose import candidates
from dfd.segmentation.choose import ladder as ladder_of
from dfd.segmentation.cut import Ladders, cut_labels, ladders_of
from dfd.segmentation.follow import Follow
from dfd.segmentation.levels import Ladder
from dfd.segmentation.patches import Patches
from dfd.segmentation.trees import Trees
from dfd.symmetry.plane import SymmetryPlane
from dfd.symmetry.search import symmetry_planes

MOST_LADDERS = 256  # number of patches whose levels are kept, each with up to 0.5 MB
# FRAGMENT: components of a part below this share of the largest component's area are not counted. Without, 13 shapes
# (`bench.quality people`) have 134 parts in place of 116, and the Rand distance is 0.0006 larger.
FRAGMENT = 0.1


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a shape."""

    mask: Bool = field(repr=False)  # (V,) whether each vertex belongs to the part
    share: float  # area of the part, as a fraction of the area of the surface
    components: int  # number of components of the part: the region at the place, and its counterparts
    vertex: int  # in `Parts.part`, the vertex at the given place; in `Parts.cut`, a vertex far from the part's border

    @property
    def vertices(self) -> Int64:
        """Return the vertices (N,) of the part, ascending."""
        return np.flatnonzero(self.mask)


class Parts:
    """The parts of the shape `mesh`. The first call of a method computes the trees of all regions.

    `features` is a function that returns the features (N, D) of vertices (N,), such as `field.on(mesh).rows`. `planes`
    is a function that returns the planes of symmetry of the shape. If it is left out, the shape has none.
    """

    def __init__(
        self, mesh: Mesh, features: Callable[[Int64], Float32], planes: Callable[[], Sequence[SymmetryPlane]] = tuple
    ) -> None:
        self._mesh, self._features, self._planes = mesh, features, planes

    def __repr__(self) -> str:
        return f"Parts({self._mesh!r})"

    def part(self, at: Any, level: int = 0, *, follow: Follow = "all") -> Part:
        """Return the part at a place.

        Raises ValueError if `at` is no vertex or point, `level` is no whole number, `follow` is another word, or no
        face has an area above 0.

        Parameters
        ----------
        at
            A vertex index, or a point (3,) in mesh units, which stands for the nearest vertex.
        level
            0 is the part that a user most likely means. −1, −2, … are smaller parts inside it, and 1, 2, … are larger
            parts that contain it. The next smaller and the next larger component, object or material of the file are
            the levels −1 and 1. A level beyond the smallest or the largest part stands for that part.
        follow
            Which counterparts belong to the part: "all" that look alike, such as the other legs, only "mirror" images,
            or "none". With each of these, the part of a level contains the parts of all lower levels.
        """
        vertex = self._vertex(at)
        check.choice("Parts.part", "follow", follow, Follow)
        component, share = self._components(vertex, check.whole("Parts.part", "level", level), follow)
        mask = self._at_vertices([component < 0, component >= 0]) == 1
        first = first_at_place(self._mesh)
        mask |= first == first[vertex]  # the interpolation can exclude the vertex from a small part
        return Part(mask, share, int(component.max()) + 1, vertex)

    def components(self, at: Any, level: int = 0) -> Int64 | None:
        """Return the component of the part at a place that contains each mesh node (`dfd.geometry.coarse`), (N,).

        0 is the component at the place, 1, 2, … are its counterparts, the most similar first, and −1 is outside. The
        result is None if no face has an area, or if `level` is 0 and no part at the place has a clear border, as on a
        ball.
        """
        if not self._has_surface:
            return None
        vertex = self._vertex(at)
        if level == 0 and not self._ladder(vertex).clear:
            return None
        return self._components(vertex, level, "all")[0]

    def left_out(self, at: Any, level: int = 0) -> list[int]:
        """Return a vertex of each region that may be of the part's kind, but is not likely enough to follow.

        Its probability is at least one third. `at` and `level` are as in `part`. The most likely region is the first.
        """
        if not self._has_surface:
            return []
        vertex, of_vertex = self._vertex(at), self._patches.of_vertex
        ladder = self._ladder(vertex)
        held, region = np.any(ladder.components(level, "all"), axis=0), ladder.region(level)
        possible = self._alike.followers(region, within=~held | region, least=POSSIBLE)
        outside = self._components(vertex, level, "all")[0][self._patches.nodes.of_vertex] < 0  # after borders moved
        left = [np.flatnonzero(each.region[of_vertex] & outside) for each in possible]
        return [int(vertices[0]) for vertices in left if len(vertices)]

    def levels(self, at: Any) -> tuple[int, int]:
        """Return the lowest and the highest level at a place; both are 0 if there is one part only, or no surface."""
        if not self._has_surface:
            return 0, 0
        ladder = self._ladder(self._vertex(at))
        return ladder.lowest, ladder.highest

    def cut(self, count: int | None = None, *, instances: bool = False) -> list[Part]:
        """Return parts that cover the whole shape, the largest first. Every vertex belongs to exactly one part.

        `count` is a number of parts to aim at, at least 1. If there are fewer parts, they are divided, as far as lower
        levels have smaller parts. If there are more, the smallest ones join the parts that they touch most.

        Counterparts belong to the same part. With `instances`, each of them is a part of its own: four legs are four
        parts, and count as one. The parts are those that handles hold at places all over the surface.

        Raises ValueError if no face has an area above 0, or `count` is below 1.
        """
        wanted = None if count is None else check.whole("Parts.cut", "count", count, minimum=1)
        patches, label = self._patches, cut_labels(self._trees, self._cut_ladders, wanted)
        masks = label == np.unique(label)[:, None]
        claims = np.array([snapped(patches, inside) for inside in masks])
        # `snapped` moves borders to creases. Places that it puts into no part or several parts keep their patch's part.
        of_place = np.where(claims.sum(axis=0) == 1, claims.argmax(axis=0), masks.argmax(axis=0)[patches.of_place])
        of_node = np.where(patches.place >= 0, of_place[patches.place], masks.argmax(axis=0)[patches.of_node])
        of_vertex = self._at_vertices([of_node == number for number in range(len(masks))])
        found = []
        for number, inside in enumerate(masks):
            mask = of_vertex == number
            if mask.any():
                depth = patches.borders.depth(inside)
                deepest = np.where(inside & np.isfinite(depth), depth, -1.0).argmax()
                inner = mask & (patches.of_vertex == deepest)
                vertex = int((inner if inner.any() else mask).argmax())
                found.append(Part(mask, float(patches.area @ inside), self._count(inside), vertex))
        if instances:
            found = [each for part in found for each in self._instances(part)]
        return sorted(found, key=lambda each: -each.share)

    def face_labels(self, found: Sequence[Part]) -> Int64:
        """Return the index in `found`, the result of `cut`, of the part of each face, (F,).

        A face belongs to the part of most of its corners, or of its first corner. `np.savetxt(path, labels, "%d")`
        writes a .seg file of the Princeton benchmark.
        """
        corners = np.argmax([part.mask for part in found], axis=0)[self._mesh.representative[self._mesh.faces]]
        return np.where(corners[:, 1] == corners[:, 2], corners[:, 1], corners[:, 0]).astype(np.int64)

    def _instances(self, part: Part) -> list[Part]:
        """Return the components of a part as parts. Fragments belong to the largest component."""
        mesh, count = self._mesh, len(self._mesh.vertices)
        first = first_at_place(mesh)
        corners = first[mesh.faces]
        areas = np.bincount(corners.ravel(), np.repeat(face_areas(mesh.vertices, mesh.faces) / 3, 3), minlength=count)
        edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        edges = edges[part.mask[edges].all(axis=1)]
        graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
        component = connected_components(graph, directed=False)[1][first]
        used, own = np.unique(component[part.mask], return_inverse=True)
        sizes = np.bincount(own, areas[part.mask], minlength=len(used))
        own = np.where((sizes > FRAGMENT * sizes.max())[own], own, sizes.argmax())
        result = []
        for number in np.unique(own):
            vertices = np.flatnonzero(part.mask)[own == number]
            mask = np.zeros(count, bool)
            mask[vertices] = True
            places = mesh.vertices[vertices]
            middle = int(np.square(places - places.mean(axis=0)).sum(axis=1).argmin())
            vertex = part.vertex if mask[part.vertex] else int(vertices[middle])
            share = part.share * float(areas[vertices].sum() / max(areas[part.mask].sum(), 1e-300))
            result.append(Part(mask, share, 1, vertex))
        return result

    def prepare(self) -> None:
        """Compute the trees of regions, which takes half a second, or several seconds for a million faces."""
        if self._has_surface:
            _ = self._trees

    def _components(self, vertex: int, level: int, follow: Follow) -> tuple[Int64, float]:
        """Return `components` (N,) at a vertex, and the part's share of the surface."""
        patches, ladder = self._patches, self._ladder(vertex)
        regions = np.array(ladder.components(level, follow))
        inside: Bool = np.any(regions, axis=0)
        side = ladder.side(level, follow, int(patches.place[patches.nodes.of_vertex[vertex]]))
        component = np.where(inside, regions.argmax(axis=0), -1)[patches.of_place]
        lost = np.flatnonzero(side & (component < 0))
        if len(lost):  # the border moved outwards: these places belong to the nearest component
            center, known = patches.nodes.center[patches.node_of_place], np.flatnonzero(side & (component >= 0))
            component[lost] = component[known[cKDTree(center[known]).query(center[lost])[1]]] if len(known) else 0
        component[~side] = -1
        component = np.where(patches.place >= 0, component[patches.place], -1)
        component[patches.nodes.of_vertex[vertex]] = 0
        return component, float(patches.area @ inside)

    def _ladder(self, vertex: int) -> Ladder:
        """Return the levels at the patch of a vertex. Those used last are kept."""
        patch = int(self._patches.of_vertex[vertex])

        def find() -> Ladder:
            found = candidates(self._trees, patch)
            rungs, middle = ladder_of(found, self._patches.area)
            return Ladder(self._alike, list(found.regions[rungs]), middle, found.clear)

        return self._ladders.get("ladder", patch, find)

    def _count(self, inside: Bool) -> int:
        """Return the number of components of the patches `inside` (P,) that are no fragments."""
        area = self._patches.area
        sizes = [area @ each for each in self._trees.components(inside)]
        return int(sum(size > FRAGMENT * max(sizes) for size in sizes))

    def _at_vertices(self, masks: Sequence[Bool]) -> Int64:
        """Interpolate `masks` (N,) to vertices. Return the index of the mask that is largest at each vertex, (V,)."""
        shares = self._patches.nodes.shares(np.array(masks, np.float64))
        best = np.zeros(len(self._mesh.vertices), np.float32)
        label = np.zeros(len(best), np.int64)
        for number, (vertices, share) in enumerate(shares):
            more = share > best[vertices]
            label[vertices[more]], best[vertices[more]] = number, share[more]
        return label

    def _vertex(self, at: Any) -> int:
        if np.ndim(at) == 0:
            return int(check.vertex_indices("Parts.part", "at", [at], len(self._mesh.vertices))[0])
        point = check.array("Parts.part", "at", at, (3,), dtype=np.float64)
        return int(self._nearest.query(point)[1])

    @cached_property
    def _cut_ladders(self) -> Ladders:
        return ladders_of(self._trees)

    @cached_property
    def _ladders(self) -> Kept:
        return Kept(MOST_LADDERS)

    @cached_property
    def _alike(self) -> Alike:
        return Alike(self._trees)

    @cached_property
    def _has_surface(self) -> bool:
        return bool(face_areas(self._mesh.vertices, self._mesh.faces).any())

    @cached_property
    def _nearest(self) -> cKDTree:
        return cKDTree(self._mesh.vertices)

    @cached_property
    def _patches(self) -> Patches:
        return Patches(self._mesh, self._planes())

    @cached_property
    def _trees(self) -> Trees:
        return Trees(self._patches, self._patches.means(self._features))


def cut_document(found: Sequence[Part]) -> dict[str, Any]:
    """Return the parts as a JSON document: a table of the parts, numbered from 1, and the part of every vertex."""
    rows = [
        {"part": number, "share": round(each.share, 4), "components": each.components, "vertex": each.vertex}
        for number, each in enumerate(found, start=1)
    ]
    return {"parts": rows, "part_of_vertex": (1 + np.argmax([part.mask for part in found], axis=0)).tolist()}


def parts(mesh: MeshLike, field: Field) -> Parts:
    """Return the parts of `mesh`, found by the features of `field`. `mesh` can be anything that `dfd.load` reads."""
    known = check.field("parts", field)
    shape = as_mesh(mesh)
    return Parts(shape, known.on(shape).rows, partial(symmetry_planes, shape, known))
