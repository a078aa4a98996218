"""Weights by methods that know nothing of features: distances, and libigl's where it is installed."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import dfd
from dfd.common.linear_algebra import Float32, Float64, Int32, Int64
from dfd.distillation.thickness import thicknesses
from dfd.mesh.normalization import box_normalization
from dfd.views.raycast import Scene

PATIENCE = 120.0  # seconds that a peer gets for one shape


class PeerError(RuntimeError):
    """A peer gave no usable weights; the message says why."""


def euclidean(vertices: NDArray[np.floating], handles: NDArray[np.integer]) -> Float64:
    """1 − distance through space, of the farthest vertex's: (V, H)."""
    distance = np.linalg.norm(vertices[:, None] - vertices[handles], axis=2)
    return 1 - distance / np.maximum(distance.max(axis=0), 1e-300)


def geodesic(geodesics: dfd.Geodesics, handles: NDArray[np.integer]) -> Float32:
    """1 − distance along the surface, of the farthest vertex's: (V, H)."""
    return 1 - geodesics.distances(handles).T


def thickness(mesh: dfd.Mesh, handles: NDArray[np.integer]) -> Float64:
    """1 − how many times thicker or thinner the shape is there, as a logarithm, of the largest such ratio: (V, H).

    Of faces, and of vertices the mean of theirs (shape diameter function; see `dfd.distillation.thickness`).
    """
    center, scale = box_normalization(*mesh.bounds) or (np.zeros(3), 1.0)
    vertices = (mesh.vertices - center) * scale
    corners = vertices[mesh.faces]
    component = components_of(mesh.faces, len(vertices))[mesh.faces[:, 0]]
    thick = thicknesses(Scene(vertices, mesh.faces), corners, corners.mean(axis=1), component)
    around = np.log(np.maximum(thick, 1e-3)).repeat(3)
    total, count = (np.bincount(mesh.faces.ravel(), each, len(vertices)) for each in (around, np.ones_like(around)))
    value = total / np.maximum(count, 1)
    apart = np.abs(value[:, None] - value[handles])
    return np.asarray(1 - apart / np.maximum(apart.max(axis=0), 1e-300))


def rounds(labels: NDArray[np.integer], handles: NDArray[np.integer]) -> list[Int64]:
    """Columns of `handles` in rounds of one handle a part, the way a person would place them."""
    count: dict[int, int] = {}
    found: dict[int, list[int]] = {}
    for column, handle in enumerate(handles):
        part = int(labels[handle])
        found.setdefault(count.get(part, 0), []).append(column)
        count[part] = count.get(part, 0) + 1
    return [np.array(columns) for columns in found.values()]


def biharmonic(mesh: dfd.Mesh, labels: NDArray[np.integer], handles: NDArray[np.integer], *, bounded: bool) -> Float64:
    """Biharmonic weights (V, H) over the surface by libigl; `bounded` ones by its quadratic program (BBW).

    Such weights fall off towards the other handles: each round of one handle a part is solved by itself, 1 at the
    handle and 0 at the others. Unbounded weights are cut to [0, 1].

    Raises PeerError if libigl is not installed, fails, crashes or takes longer than `PATIENCE`, or a component of the
    surface has no handle: the equations leave its weights open.
    """
    vertices, faces = np.ascontiguousarray(mesh.vertices), mesh.faces.astype(np.int64)
    columns = rounds(labels, handles)
    for each in columns:
        check_components(mesh.faces, len(vertices), np.asarray(handles)[each])
    solved = in_child(_solve, vertices, faces, [np.asarray(handles)[each] for each in columns], bounded)
    weights = np.empty((len(vertices), len(handles)))
    for each, values in zip(columns, solved, strict=True):
        weights[:, each] = values
    if not np.isfinite(weights).all():
        raise PeerError("gives NaN")
    return weights.clip(0, 1)


def in_child(function: Callable[..., Any], *arguments: Any, seconds: float = PATIENCE) -> Any:
    """What `function` returns in a process of its own, so that a peer can neither hang nor crash the bench.

    Raises PeerError if it raises, dies, or takes longer than `seconds`.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    child = context.Process(target=_answer, args=(theirs,), daemon=True)
    child.start()
    theirs.close()
    try:
        ours.send((function, arguments))  # not at the start, where a child that dies at once would never be noticed
        if not ours.poll(seconds):
            raise PeerError(f"takes longer than {seconds:g} s")
        fine, result = ours.recv()
    except (EOFError, BrokenPipeError, ConnectionResetError):
        child.join()
        raise PeerError(f"crashes (exit code {child.exitcode})") from None
    finally:
        child.kill()
        child.join()
        ours.close()
    if not fine:
        raise PeerError(result)
    return result


def _answer(connection: Connection) -> None:
    function, arguments = connection.recv()
    try:
        answer = (True, function(*arguments))
    except Exception as error:  # whatever a peer raises is its result
        answer = (False, (str(error).splitlines() or [type(error).__name__])[0])
    connection.send(answer)


def components_of(corners: NDArray[np.integer], count: int) -> Int32:
    """The number (count,) of the connected component of elements (E, K), such as faces, that each vertex is of."""
    edges = corners[:, [[a, a + 1] for a in range(corners.shape[1] - 1)]].reshape(-1, 2)
    graph = coo_array((np.ones(len(edges), bool), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def check_components(corners: NDArray[np.integer], count: int, held: NDArray[np.integer]) -> None:
    """Raise PeerError unless every component of elements (E, K), of `count` vertices, holds one of `held`."""
    component = components_of(corners, count)
    if len(np.unique(component[held])) <= component.max():
        raise PeerError(f"needs a handle or a fixed point on every one of the {component.max() + 1} components")


def libigl() -> Any:
    """The module, or PeerError where it is not installed."""
    try:
        import igl
    except ImportError:
        raise PeerError("libigl is not installed") from None
    return igl


def bounded_weights(vertices: Float64, cells: Int64, known: Int64, values: Float64) -> Float64:
    """Bounded biharmonic weights (V, K), over faces or in tetrahedra, that have `values` (P, K) at `known` (P,)."""
    solved = np.asarray(libigl().bbw(vertices, cells, known, np.ascontiguousarray(values)))
    if solved.shape != (len(vertices), values.shape[1]) or not np.isfinite(solved).all():
        raise PeerError("finds no solution")
    return solved


def _solve(vertices: Float64, faces: Int64, handle_sets: list[Int64], bounded: bool) -> list[Float64]:
    every = [(handles, np.eye(len(handles))) for handles in handle_sets]
    if bounded:
        return [bounded_weights(vertices, faces, *each) for each in every]
    return [np.asarray(libigl().harmonic(vertices, faces, *each, 2)) for each in every]
