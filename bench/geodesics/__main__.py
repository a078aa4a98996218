"""`python -m bench.geodesics`: errors against exact distances and times, of the meshes in DFD_MESHES.

Exact distances (Mitchell, Mount and Papadimitriou 1987) come from pygeodesic. For a subdivided mesh they are those of
the mesh itself, at its own vertices: subdivision at the middles of edges moves no point of the surface.
"""

from __future__ import annotations

import argparse
import os
from functools import cache
from pathlib import Path

import numpy as np
import pygeodesic.geodesic
import trimesh
from rich.console import Console
from rich.table import Table

import dfd
from bench.geodesics.heat import heat_seconds, shortest_seconds
from bench.quality.baselines import PeerError, in_child
from dfd.common.linear_algebra import Float64

MESHES = (("spot.obj", 0), ("koala.obj", 0), ("scorpion.obj", 0), ("koala.obj", 2))
COLUMNS = (
    "mesh",
    "faces",
    "prepare s",
    "handle ms",
    "heat factor s",
    "heat solve ms",
    "ratio",
    "mean error",
    "largest",
)
MEAN_TARGET, LARGEST_TARGET = 0.015, 0.05


def main() -> None:
    """Print the table, and say at the end whether every error is within its target."""
    parser = argparse.ArgumentParser(prog="python -m bench.geodesics", description=__doc__)
    parser.add_argument("--handles", type=int, default=2, help="on each mesh (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=9, help="of each timing, best taken (default: %(default)s)")
    parser.add_argument("--no-heat", action="store_true", help="leave out the heat method on the full mesh")
    parser.add_argument(
        "--limit", type=float, default=120.0, help="seconds for the heat method on one mesh (default: %(default)s)"
    )
    options = parser.parse_args()
    if "DFD_MESHES" not in os.environ:
        parser.error("DFD_MESHES names no folder of meshes")
    folder = Path(os.environ["DFD_MESHES"])
    table = Table(*COLUMNS, title=f"{dfd.get_num_threads()} threads; errors as shares of the largest exact distance")
    within = True
    console = Console(width=150)
    limit = 0.0 if options.no_heat else options.limit
    for name, rounds in MESHES:
        row, mean, largest = _measure(folder / name, rounds, options.handles, options.repeats, limit)
        within = within and mean <= MEAN_TARGET and largest <= LARGEST_TARGET
        table.add_row(*row)
        console.print("  ".join(row))  # the next one may take minutes
    console.print(table)
    console.print(
        f"errors {'within' if within else 'NOT within'} {MEAN_TARGET:.1%} on average and {LARGEST_TARGET:.0%}"
    )


def _measure(path: Path, rounds: int, handle_count: int, repeats: int, limit: float) -> tuple[list[str], float, float]:
    """Return a row of the table, the mean and the largest error."""
    given = dfd.load(path)
    handles = np.random.default_rng(1).integers(0, len(given.vertices), handle_count)
    exact = _exact(path, tuple(handles.tolist()))
    vertices, faces = given.vertices, given.faces
    for _ in range(rounds):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    mesh = dfd.Mesh(vertices, faces)
    geodesics = dfd.Geodesics(mesh)
    prepare = shortest_seconds(geodesics.prepare, 1)
    handle = shortest_seconds(lambda: geodesics.distances(handles[:1]), repeats)
    found = geodesics.distances(handles)[:, : len(given.vertices)] * geodesics.extent
    errors = np.abs(found - exact) / exact.max(axis=1, keepdims=True)
    peer = _heat(mesh, int(handles[0]), handle, limit) if limit else ["", "", ""]
    row = [path.name, f"{len(faces):,}", f"{prepare:.2f}", f"{1e3 * handle:.1f}", *peer]
    return [*row, f"{errors.mean():.2%}", f"{errors.max():.2%}"], float(errors.mean()), float(errors.max())


@cache
def _exact(path: Path, handles: tuple[int, ...]) -> Float64:
    mesh = dfd.load(path)
    size = float(mesh.extents.max())  # the library is at ease with a size of about 1
    solver = pygeodesic.geodesic.PyGeodesicAlgorithmExact((mesh.vertices - mesh.bounds[0]) / size, mesh.faces)
    return size * np.stack([solver.geodesicDistances(np.array([handle]))[0] for handle in handles])


def _heat(mesh: dfd.Mesh, handle: int, seconds: float, limit: float) -> list[str]:
    """Return the times of the heat method on the full mesh, and how many times as fast ours is.

    On a million faces its factorization takes minutes and cannot be interrupted.
    """
    try:
        factor, solve = in_child(heat_seconds, mesh.vertices, mesh.faces, handle, seconds=limit)
    except PeerError as error:
        return [str(error), "", ""]
    return [f"{factor:.1f}", f"{1e3 * solve:.0f}", f"{solve / seconds:.0f}"]


if __name__ == "__main__":
    main()
