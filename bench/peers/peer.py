"""Run and time a peer, a method that DFD is compared with. It runs in a separate process, because it may hang or crash.

fTetWild fills surfaces with tetrahedra for peers (Hu et al., "Fast Tetrahedral Meshing in the Wild", 2020).
"""

import contextlib
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeoutError
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

import fast_simplification
import igl
import numpy as np
from scipy.spatial import KDTree

import dfd
from dfd.common.linear_algebra import Float64, Int64

PATIENCE = 300.0  # time limit in seconds for one peer on one shape, without the time to fill it with tetrahedra
FILLING_PATIENCE = 900.0  # time limit in seconds for the tetrahedra of one shape
EDGE = 0.05  # edge length of the tetrahedra, as a fraction of the bounding box's diagonal
MOST_OFF_ONE = 1e-3  # largest accepted deviation of a node's sum of weights from 1
MOST_FACES = 6_000  # largest number of faces of a surface that is filled; more would take minutes on two cores
AWAY = 0.08  # largest accepted distance of a vertex from the tetrahedra, as a fraction of the diagonal


class PeerError(RuntimeError):
    """A peer gave no usable result; the message says why."""


@dataclass(frozen=True)
class Tetrahedra:
    """Tetrahedra that fill a surface, and for each vertex of the surface the closest point on their boundary."""

    nodes: Float64  # (N, 3)
    cells: Int64  # (T, 4)
    corners: Int64  # (V, 3) indices of the nodes of the boundary triangle with the closest point
    barycentric: Float64  # (V, 3) coordinates of the closest point in its triangle
    seconds: float  # time to fill the surface

    def nearest(self, points: Float64) -> Int64:
        """Return the index of the node nearest to each of the points (P, 3)."""
        return KDTree(self.nodes).query(points)[1].astype(np.int64)

    def on_surface(self, values: Float64) -> Float64:
        """Return values (V, D) at the vertices of the surface, interpolated from `values` (N, D) at the nodes."""
        return np.einsum("vk,vkd->vd", self.barycentric, values[self.corners])


@dataclass(frozen=True)
class Body:
    """A surface without unused vertices, and the tetrahedra that fill it, for peers that need them."""

    vertices: Float64  # (V, 3)
    faces: Int64  # (F, 3)
    within: Tetrahedra | None = None


Deform = Callable[[Float64], Float64]  # maps targets (N, 3) of the held vertices to the deformed vertices (V, 3)
# Maps held vertices (N,) and their groups (N,) to a `Deform`. A group moves together; vertices of group −1 are fixed.
Bind = Callable[[Int64, Int64], Deform]


@dataclass(frozen=True)
class Peer:
    """A method in three timed steps: prepare a shape, bind handles, deform. Each step may raise PeerError."""

    prepare: Callable[[Body], Bind]
    volume: bool = False  # whether the method needs tetrahedra


@dataclass(frozen=True)
class Job:
    """The constraints of one deformation."""

    held: Int64  # (N,) vertex indices
    group: Int64  # (N,) group of each held vertex, −1 for fixed vertices
    targets: Float64  # (N, 3) positions that the held vertices shall reach, mesh units


@dataclass(frozen=True)
class Done:
    """The result of a job: the deformed vertices (V, 3), mesh units, and the seconds of every step."""

    vertices: Float64
    seconds: dict[str, float]


def run(
    peer: Peer,
    mesh: dfd.Mesh,
    jobs: Sequence[Job],
    *,
    patience: float = PATIENCE,
    most_faces: int | None = MOST_FACES,
    edge: float = EDGE,
) -> list[Done]:
    """Run `jobs` on one shape with one peer, in a separate process, within `patience` seconds.

    Tetrahedra have edges of `edge` times the diagonal. They fill a copy of the shape with at most `most_faces` faces,
    within `FILLING_PATIENCE` seconds. If `most_faces` is None, they fill the shape itself, within `patience` seconds.

    Raises PeerError if the peer does not support the shape or the handles, fails, crashes or takes too long.
    """
    used, faces = np.unique(mesh.faces, return_inverse=True)  # a vertex without a face makes equations singular
    vertices, faces = mesh.vertices[used], faces.reshape(-1, 3).astype(np.int64)
    filling = FILLING_PATIENCE if most_faces else patience
    within = tetrahedra(vertices, faces, filling, most_faces, edge) if peer.volume else None
    body = Body(vertices, faces, within)
    own = [Job(np.searchsorted(used, mesh.representative[job.held]), job.group, job.targets) for job in jobs]
    done = []
    for moved, seconds in in_child(_run, peer, body, own, seconds=patience):
        if not np.isfinite(moved).all():
            raise PeerError("gives NaN")
        result = mesh.vertices.copy()
        result[used] = moved
        if body.within is not None:
            seconds = {"tetrahedra": body.within.seconds, **seconds}
        done.append(Done(result[mesh.representative], seconds))
    return done


def _run(peer: Peer, body: Body, jobs: Sequence[Job]) -> list[tuple[Float64, dict[str, float]]]:
    begin = time.perf_counter()
    bind = peer.prepare(body)
    prepared = time.perf_counter() - begin
    done = []
    for job in jobs:
        start = time.perf_counter()
        deform = bind(job.held, job.group)
        bound = time.perf_counter()
        moved = deform(job.targets)
        done.append((moved, {"prepare": prepared, "bind": bound - start, "pose": time.perf_counter() - bound}))
    return done


def on_nodes(body: Body, held: Int64) -> tuple[Int64, Int64]:
    """Return the K distinct nodes nearest to the vertices `held` (N,), and the first index in `held` for each node."""
    nodes, first = np.unique(body.within.nearest(body.vertices[held]), return_index=True)
    return nodes, first


def check_sums(weights: Float64) -> None:
    """Raise PeerError unless the weights (N, K) of each node sum to 1, so that moving all handles moves the shape."""
    off = float(np.abs(weights.sum(axis=1) - 1).max())
    if not off <= MOST_OFF_ONE:  # also for NaN
        raise PeerError(f"gives weights whose sum at a node differs from 1 by {off:.2g}")


def check_components(corners: Int64, held: Int64) -> None:
    """Raise PeerError unless each connected component of a mesh with elements `corners` (E, K) has a node in `held`."""
    component = igl.vertex_components(corners)
    if len(np.unique(component[held])) <= component.max():
        raise PeerError(f"needs a handle or a fixed point on every one of the {component.max() + 1} components")


def in_child(function: Callable[..., Any], *arguments: Any, seconds: float) -> Any:
    """Run `function` in a separate process and return its result. Raise PeerError if it fails or exceeds `seconds`."""
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        answer = pool.submit(function, *arguments)
        try:
            return answer.result(seconds)
        except FutureTimeoutError:
            raise PeerError(f"takes longer than {seconds:g} s") from None
        except BrokenProcessPool:
            raise PeerError("crashes") from None
        except Exception as error:  # the first line of any error becomes the message of a PeerError
            raise PeerError((str(error).splitlines() or [type(error).__name__])[0]) from None
        finally:
            for child in set(multiprocessing.active_children()) - others:
                child.kill()


cached: dict[Any, Tetrahedra | PeerError] = {}  # by shape and settings: several peers use the same tetrahedra


def tetrahedra(
    vertices: Float64, faces: Int64, patience: float, most_faces: int | None = None, edge: float = EDGE
) -> Tetrahedra:
    """Simplify a surface to at most `most_faces` faces, if given, and fill it with tetrahedra. Cache the result.

    Raises PeerError if the surface cannot be filled within `patience` seconds.
    """
    key = vertices.tobytes(), faces.tobytes(), most_faces, edge
    if key not in cached:
        try:
            cached[key] = in_child(_fill, vertices, faces, most_faces, edge, seconds=patience)
        except PeerError as error:
            cached[key] = error
    found = cached[key]
    if isinstance(found, PeerError):
        raise found
    return found


def _fill(vertices: Float64, faces: Int64, most: int | None, edge: float) -> Tetrahedra:
    import wildmeshing  # the tests run without it

    begin = time.perf_counter()
    points, sides = vertices, faces
    if most is not None and len(faces) > most:
        points, sides = fast_simplification.simplify(vertices.astype(np.float32), faces, target_count=most)
    # fTetWild prints every step, so stdout is redirected to nothing. It also writes a file into the working folder.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        tetrahedralizer = wildmeshing.Tetrahedralizer(stop_quality=30, max_its=30, edge_length_r=edge)
        center = np.mean(points, axis=0, dtype=np.float64)
        tetrahedralizer.set_mesh(points - center, np.asarray(sides, np.int32))
        tetrahedralizer.tetrahedralize()
        positions, corners = tetrahedralizer.get_tet_mesh()[:2]
    if len(corners) == 0:
        raise PeerError("cannot be filled with tetrahedra: the surface encloses no volume")
    used, corners = np.unique(corners, return_inverse=True)
    nodes, cells = np.ascontiguousarray(positions[used] + center), corners.reshape(-1, 4).astype(np.int64)
    boundary = igl.boundary_facets(cells)[0]
    squared, face, closest = igl.point_mesh_squared_distance(np.ascontiguousarray(vertices), nodes, boundary)
    farthest = np.sqrt(squared.max()) / np.linalg.norm(np.ptp(vertices, axis=0))
    if farthest > AWAY:
        raise PeerError(f"cannot be filled: the tetrahedra miss a vertex by {100 * farthest:.0f} % of the diagonal")
    corners = boundary[face]
    barycentric = igl.barycentric_coordinates(closest, *(np.ascontiguousarray(nodes[corner]) for corner in corners.T))
    return Tetrahedra(nodes, cells, corners, barycentric, time.perf_counter() - begin)
