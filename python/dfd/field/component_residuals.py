"""Feature residuals of the connected components of a surface, for components that overlap in space.

A network of position alone gives a helmet and the head inside it their mean feature. So the field of a shape with
several components also stores sample points of each, with the difference of their features from the network's. On a
mesh whose components match these, a vertex gets the network's feature plus the interpolated residual of its component.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int32, Int64
from dfd.geometry.topology import face_components, first_at_place

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from dfd.mesh.mesh import Mesh

NEIGHBORS = 8  # number of sample points of its component that a vertex interpolates
# Largest difference between the corners of matching components, normalized. Other resolutions differ by less.
SAME = 0.02
_APART = 10.0  # offset between components in the search for neighbors, more than any distance within [−1, 1]³
_ROWS_AT_ONCE = 1 << 16  # to bound memory


@dataclass(frozen=True, eq=False)
class ComponentResiduals:
    """The components of a surface in normalized coordinates, and the residuals of their features.

    Raises ValueError if an array has the wrong shape, a number is not finite, or a component does not exist.
    """

    boxes: Float32  # (P, 6) float32, the smallest and the largest corner of the box around each component
    points: Float32  # (N, 3) float32, sample points on the surface
    component: Int32  # (N,) int32, the component of each point
    differences: NDArray[np.float16]  # (N, D) float16, the feature at each point less that of the network

    def __post_init__(self) -> None:
        count = np.shape(self.points)[:1]
        width = np.shape(self.differences)[1:]
        checked = {
            "boxes": _checked("boxes", self.boxes, ("P", 6), np.float32),
            "points": _checked("points", self.points, ("N", 3), np.float32),
            "component": check.vertex_indices(
                "ComponentResiduals", "component", self.component, len(self.boxes)
            ).astype(np.int32),
            "differences": _checked("differences", self.differences, (*count, *width), np.float16),
        }
        if checked["component"].shape != count or len(width) != 1:
            raise ArgumentError(
                "component",
                f"and `differences` must have a row for each of the {count[0]} points, "
                f"got {checked['component'].shape} and {np.shape(self.differences)}",
                "ComponentResiduals",
            )
        for name, array in checked.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def dimension(self) -> int:
        """Width D of a feature row."""
        return int(self.differences.shape[1])

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def widened(self, directions: Float32) -> ComponentResiduals:
        """Return the same components with differences multiplied by `directions` (d, D), of width D."""
        return ComponentResiduals(
            self.boxes, self.points, self.component, (self.differences @ directions).astype(np.float16)
        )

    def known(self, boxes: NDArray[np.floating]) -> Int64:
        """Return the component (Q,) that each of `boxes` (Q, 6) matches, or −1."""
        from scipy.spatial import cKDTree

        if len(boxes) == 0 or len(self.boxes) == 0:
            return np.full(len(boxes), -1)
        distance, found = cKDTree(self.boxes).query(boxes, p=np.inf)
        return np.where(distance <= SAME, found, -1)

    def add_residuals(self, rows: Float32, points: NDArray[np.floating], component: NDArray[np.integer]) -> Float32:
        """Add the residuals of the `component` (N,) of each of `points` (N, 3), normalized, to unit `rows` (N, D).

        The residual is a weighted mean over the nearest sample points of the component. Weights fall to 0 at the next
        nearest point, so the residual is continuous. A component of −1 leaves a row unchanged.
        """
        result = rows.copy()
        of_some = np.flatnonzero(component >= 0)
        for start in range(0, len(of_some), _ROWS_AT_ONCE):
            chosen = of_some[start : start + _ROWS_AT_ONCE]
            changed = rows[chosen]
            changed += self._differences_at(points[chosen], component[chosen])
            length = np.sqrt(np.einsum("ij,ij->i", changed, changed))
            changed /= np.maximum(length, np.float32(1e-6))[:, None]
            vanished = length < 1e-6  # without a direction, the row stays unchanged
            changed[vanished] = rows[chosen[vanished]]
            result[chosen] = changed
        return result

    def _differences_at(self, points: NDArray[np.floating], component: NDArray[np.integer]) -> Float32:
        from scipy import sparse

        wanted = min(NEIGHBORS + 1, len(self.points))
        distance, near = self._tree.query(apart(points, component), np.arange(1, wanted + 1), workers=-1)
        own = self.component[near] == component[:, None]
        distance = np.where(own, distance, np.inf)
        # A component of a few points has no next nearest point; all its points are then weighted by distance.
        reach = np.where(own[:, -1], distance[:, -1], 2 * np.where(own, distance, 0).max(axis=1) + 1e-6)[:, None]
        share = np.where(own, np.maximum(1 - distance / np.maximum(reach, 1e-12), 0) ** 2 + 1e-9 * own, 0)
        share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-30)
        gather = sparse.csr_matrix(
            (share.ravel().astype(np.float32), near.ravel(), np.arange(0, near.size + 1, wanted)),
            shape=(len(points), len(self.points)),
        )
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
    """Return the component (V,) of each vertex of `mesh`, −1 without a face, and the components' boxes (P, 6).

    Vertices at one position count as one. Boxes are in mesh units.
    """
    place = first_at_place(mesh)
    faces = place[mesh.faces]
    component = np.full(len(mesh.vertices), -1, np.int32)
    component[faces.ravel()] = np.repeat(face_components(faces), 3)
    component = component[place]
    return component, _boxes(mesh.vertices, component)


def boxes_of_components(vertices: NDArray[np.floating], faces: NDArray[np.integer], component: Int32) -> Float64:
    """Return the boxes (P, 6) around the faces (F, 3) of each component (F,) of a surface with vertices (V, 3)."""
    of_vertex = np.full(len(vertices), -1, np.int32)
    of_vertex[faces.ravel()] = np.repeat(component, 3)
    return _boxes(vertices, of_vertex)


def _boxes(points: NDArray[np.floating], component: Int32) -> Float64:
    """Return the boxes (P, 6) around the points (N, 3) of each component (N,); −1 is no component."""
    count = int(component.max(initial=-1)) + 1
    some = component >= 0
    boxes = np.concatenate([np.full((count, 3), np.inf), np.full((count, 3), -np.inf)], axis=1)
    np.minimum.at(boxes[:, :3], component[some], points[some])
    np.maximum.at(boxes[:, 3:], component[some], points[some])
    return boxes


def apart(points: NDArray[np.floating], component: NDArray[np.integer]) -> Float64:
    """Return points (N, 4): `points` (N, 3) with a coordinate that separates components (N,) in neighbor searches."""
    return np.column_stack([np.asarray(points, np.float64), _APART * np.asarray(component, np.float64)])


def _checked(name: str, values: ArrayLike, shape: Any, dtype: Any) -> NDArray[Any]:
    return check.array("ComponentResiduals", name, values, shape, dtype=dtype).copy()
