"""Correct a field's features on each connected component of a surface, because components can overlap in space.

A field's network depends on position alone, so a helmet and the head inside it get nearly the same features. If a shape
has several components, its field also stores residuals at surface samples. A residual is the target feature of the fit
minus the network's feature. At a vertex, residuals of the vertex's component are interpolated and added to the feature.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int32, Int64
from dfd.common.read_only import ReadOnlyArrays
from dfd.geometry.topology import face_components, first_at_place

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from dfd.mesh.mesh import Mesh

NEIGHBORS = 8  # number of samples from which a residual is interpolated: the nearest ones on the point's component
# Two components match if the normalized coordinates of their bounding boxes differ by at most this number. Between
# resolutions of a mesh, the differences are smaller.
SAME = 0.02
_APART = 10.0  # offset between components in neighbor searches, more than any distance in [−1, 1]³
_ROWS_AT_ONCE = 1 << 16  # number of features that are computed at a time, to limit memory


@dataclass(frozen=True, eq=False)
class ComponentResiduals(ReadOnlyArrays):
    """The connected components of a surface in normalized coordinates, and residuals of their features.

    Raises ValueError if an array has the wrong shape, a number is not finite, or a point's component has no box.
    """

    boxes: Float32  # (P, 6) the lower and upper corner of each component's bounding box
    points: Float32  # (N, 3) surface samples
    component: Int32  # (N,) the component of each point
    differences: NDArray[np.float16]  # (N, D) the residual of each point

    def __post_init__(self) -> None:
        owner = "ComponentResiduals"
        count, width = np.shape(self.points)[:1], np.shape(self.differences)[1:]
        component = check.vertex_indices(owner, "component", self.component, len(self.boxes), wrap=False)
        differences = check.array(owner, "differences", self.differences, (*count, *width), dtype=np.float16)
        checked: dict[str, NDArray[Any]] = {
            "boxes": check.array(owner, "boxes", self.boxes, ("P", 6)).copy(),
            "points": check.array(owner, "points", self.points, ("N", 3)).copy(),
            "component": component.astype(np.int32),
            "differences": differences.copy(),
        }
        if component.shape != count or len(width) != 1:
            found = f"{component.shape} and {np.shape(self.differences)}"
            reason = f"and `differences` must have a row for each of the {count[0]} points, got {found}"
            raise ArgumentError("component", reason, owner)
        for name, array in checked.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def dimension(self) -> int:
        """Return the dimension D of a feature."""
        return int(self.differences.shape[1])

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def widened(self, directions: Float32) -> ComponentResiduals:
        """Return the same components with the residuals (N, d) multiplied by `directions` (d, D)."""
        differences = (self.differences @ directions).astype(np.float16)
        return ComponentResiduals(self.boxes, self.points, self.component, differences)

    def known(self, boxes: NDArray[np.floating]) -> Int64:
        """Return the index (Q,) of the component whose box matches each of `boxes` (Q, 6), or −1 if no box matches."""
        from scipy.spatial import cKDTree

        distance, found = cKDTree(self.boxes).query(boxes, p=np.inf)
        return np.where(distance <= SAME, found, -1)

    def add_residuals(self, rows: Float32, points: NDArray[np.floating], component: NDArray[np.integer]) -> Float32:
        """Return the features `rows` (N, D) plus the residuals at normalized `points` (N, 3), scaled to unit length.

        A residual is a weighted mean over the `NEIGHBORS` nearest samples on the point's `component` (N,). Weights fall
        to 0 at the distance of the next nearest sample, so residuals are continuous. Component −1 has no residuals.
        """
        result = rows.copy()
        of_some = np.flatnonzero(component >= 0)
        for start in range(0, len(of_some), _ROWS_AT_ONCE):
            chosen = of_some[start : start + _ROWS_AT_ONCE]
            changed = rows[chosen]
            changed += self._differences_at(points[chosen], component[chosen])
            length = np.sqrt(np.einsum("ij,ij->i", changed, changed))
            changed /= np.maximum(length, np.float32(1e-6))[:, None]
            vanished = length < 1e-6  # a sum near 0 has no direction, so the feature without residual is kept
            changed[vanished] = rows[chosen[vanished]]
            result[chosen] = changed
        return result

    def _differences_at(self, points: NDArray[np.floating], component: NDArray[np.integer]) -> Float32:
        from scipy import sparse

        wanted = min(NEIGHBORS + 1, len(self.points))
        distance, near = self._tree.query(apart(points, component), np.arange(1, wanted + 1), workers=-1)
        own = self.component[near] == component[:, None]
        distance = np.where(own, distance, np.inf)
        # If a component has at most `NEIGHBORS` samples, weights fall to 0 at twice the farthest one's distance.
        support = np.where(own[:, -1], distance[:, -1], 2 * np.where(own, distance, 0).max(axis=1))[:, None]
        share = np.where(own, np.maximum(1 - distance / np.maximum(support, 1e-12), 0) ** 2 + 1e-9 * own, 0)
        share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-30)
        entries = share.ravel().astype(np.float32), near.ravel(), np.arange(0, near.size + 1, wanted)
        gather = sparse.csr_matrix(entries, shape=(len(points), len(self.points)))
        return np.asarray(gather @ self._wide, np.float32)

    @cached_property
    def _wide(self) -> Float32:
        return self.differences.astype(np.float32)

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(apart(self.points, self.component))

    def __getstate__(self) -> dict[str, Any]:
        return self.arrays()


def components_of_vertices(mesh: Mesh) -> tuple[Int32, Float64]:
    """Return the component of each vertex of `mesh`, (V,), and the boxes of the components, (P, 6) in mesh units.

    Vertices at one position count as one vertex. Vertices without a face have the component −1.
    """
    place = first_at_place(mesh)
    faces = place[mesh.faces]
    component = np.full(len(mesh.vertices), -1, np.int32)
    component[faces.ravel()] = np.repeat(face_components(faces), 3)
    component = component[place]
    return component, _boxes(mesh.vertices, component)


def boxes_of_components(vertices: NDArray[np.floating], faces: NDArray[np.integer], component: Int32) -> Float64:
    """Return the boxes of the components, (P, 6); `component` (F,) is the component of each face."""
    of_vertex = np.full(len(vertices), -1, np.int32)
    of_vertex[faces.ravel()] = np.repeat(component, 3)
    return _boxes(vertices, of_vertex)


def _boxes(points: NDArray[np.floating], component: Int32) -> Float64:
    """Return the boxes (P, 6) of the components of `points` (N, 3); points with `component` (N,) −1 are left out."""
    count = int(component.max(initial=-1)) + 1
    some = component >= 0
    boxes = np.concatenate([np.full((count, 3), np.inf), np.full((count, 3), -np.inf)], axis=1)
    np.minimum.at(boxes[:, :3], component[some], points[some])
    np.maximum.at(boxes[:, 3:], component[some], points[some])
    return boxes


def apart(points: NDArray[np.floating], component: NDArray[np.integer]) -> Float64:
    """Return `points` (N, 3) with a fourth coordinate that keeps points of different `component` (N,) far apart."""
    return np.column_stack([np.asarray(points, np.float64), _APART * np.asarray(component, np.float64)])
