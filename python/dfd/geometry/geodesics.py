"""Compute distances along the surface, for locality (Eq. 7)."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import dfd._core as _core
from dfd.common import check
from dfd.common.linear_algebra import Float32, Int32, Int64
from dfd.common.threads import get_num_threads
from dfd.geometry.normalization import box_normalization
from dfd.geometry.refine import split_long_edges
from dfd.geometry.surface_graph import bridges
from dfd.geometry.topology import face_areas
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.mesh.weld import weld

_SAMPLES = 6_000  # number of vertices of a large mesh at which distances are computed; more hardly reduce the error
_LONGEST_EDGE = 1.5  # length above which edges are split, divided by the spacing between samples


@dataclass(frozen=True)
class _Prepared:
    solver: _core.Geodesics
    vertex: Int32  # (V,) the solver vertex at the position of each mesh vertex
    distinct: int  # number of distinct positions of mesh vertices; the first solver vertices are at these positions
    half: float  # half of the bounding box's longest side, in mesh units; it is the solver's unit of length


class Geodesics:
    """Distances along the surface of a mesh from any of its vertices. The first query runs a precomputation.

    The mesh can have holes, edges of more than two faces, repeated faces, and faces without area.

    Raises ValueError if `bridges` or `sampled` is not a bool.

    Parameters
    ----------
    mesh
        The surface.
    bridges
        Whether paths cross gaps between components that touch or nearly touch (see `dfd.geometry.surface_graph`). False
        separates components, as in the paper.
    sampled
        Whether distances on a large mesh are computed at about 6,000 vertices and interpolated at the others. This
        changes the results by about 0.01. False uses all vertices, as in the paper.

    Examples
    --------
    >>> import dfd
    >>> mesh = dfd.samples.chair().mesh
    >>> distances = dfd.Geodesics(mesh).distances([0, 17])
    >>> distances.shape == (2, len(mesh.vertices))
    True
    """

    def __init__(self, mesh: MeshLike, *, bridges: bool = True, sampled: bool = True) -> None:
        """Check and store the arguments, without computing distances."""
        for name, value in (("bridges", bridges), ("sampled", sampled)):
            if not isinstance(value, bool):
                raise ValueError(f"Geodesics: `{name}` must be True or False, got {value!r}")
        self._mesh = as_mesh(mesh)
        self._bridges, self._sampled = bridges, sampled
        self._lock = threading.Lock()
        self._result: _Prepared | None = None
        self._tree: cKDTree | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of a copy, which repeats the precomputation at its first query."""
        return {"_mesh": self._mesh, "_bridges": self._bridges, "_sampled": self._sampled}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["_mesh"], bridges=state["_bridges"], sampled=state["_sampled"])  # type: ignore[misc]

    def __repr__(self) -> str:
        """Return the mesh and the options that are False."""
        off = [f", {name}=False" for name in ("bridges", "sampled") if not getattr(self, f"_{name}")]
        return f"Geodesics({self._mesh!r}{''.join(off)})"

    @property
    def extent(self) -> float:
        """Return the unit of `distances`, in mesh units: about the largest distance between two connected vertices.

        All handles have the same unit, so that a locality λ (Eq. 7) has the same effect for each handle.
        """
        prepared = self.prepare()
        return prepared.solver.extent * prepared.half

    def prepare(self) -> _Prepared:
        """Run the precomputation, unless it has run before, and return its result."""
        with self._lock:
            if self._result is None:
                self._result = _prepared(self._mesh, self._bridges, self._sampled)
            return self._result

    def distances(self, handles: Any, *, separate: float = 1.0) -> Float32:
        """Return the distance of each vertex from each handle along the surface, in units of `extent`.

        Raises ValueError if `handles` has another array shape, an index out of range, or a coordinate that is not
        finite. Raises ValueError if `separate` is outside [0, 1].

        Parameters
        ----------
        handles
            (H,) vertex indices, or (H, 3) points. A point stands for the nearest vertex.
        separate
            The distance, in [0, 1], of vertices that neither the surface nor a bridge connects to the handle.

        Returns
        -------
        (H, V) distances in [0, 1], 0 at the handle.
        """
        separate = check.number("Geodesics.distances", "separate", separate, minimum=0.0, maximum=1.0)
        chosen = self._handle_vertices(handles)
        prepared = self.prepare()
        sources = prepared.vertex[chosen].astype(np.int64)
        result = np.empty((len(sources), prepared.distinct), np.float32)
        prepared.solver.distances(sources, separate, result, get_num_threads())
        return result if prepared.distinct == len(prepared.vertex) else result[:, prepared.vertex]

    def _handle_vertices(self, handles: Any) -> Int64:
        if np.ndim(handles) == 2:
            points = check.array("Geodesics.distances", "handles", handles, ("H", 3), dtype=np.float64)
            if self._tree is None:
                self._tree = cKDTree(self._mesh.vertices)
            return np.asarray(self._tree.query(points)[1], np.int64).reshape(-1)
        return check.vertex_indices("Geodesics.distances", "handles", handles, len(self._mesh.vertices))


def _prepared(mesh: Mesh, across_gaps: bool, sampled: bool) -> _Prepared:
    """Return the solver for `mesh`, with bridges if `across_gaps` is True, and with samples if `sampled` is True."""
    center, scale = box_normalization(*mesh.bounds) or (mesh.vertices[0], 1.0)
    first, vertex = weld(mesh.vertices)
    vertices = (mesh.vertices[first] - center) * scale
    faces = vertex[mesh.faces]
    spacing = np.sqrt(face_areas(vertices, faces).sum() / (1.45 * _SAMPLES))
    if spacing > 0:
        vertices, faces = split_long_edges(vertices, faces, _LONGEST_EDGE * spacing, most=4 * _SAMPLES)
    faces = np.ascontiguousarray(faces)
    links = np.zeros((0, 2), np.int32)
    if across_gaps:
        component = _core.components(len(vertices), faces, links)
        links = np.ascontiguousarray(bridges(vertices, faces, component), np.int32)
    samples = _SAMPLES if sampled else max(_SAMPLES, len(vertices))
    solver = _core.Geodesics(np.ascontiguousarray(vertices), faces, links, samples, get_num_threads())
    return _Prepared(solver, vertex, len(first), 1 / scale)
