"""`python -m bench.speed`: kernels against the machine's ceilings and other libraries.

Every line is measured in turn with the ceiling or the peer that it is held to, and written to bench/results/speed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

import dfd
import dfd._core as _core
from dfd.common.linear_algebra import Float32, Float64, Int64

from .made_input import MadeInput, make_input
from .measure import Timing, copying, product, reading, together

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "speed"
COLUMNS = ("work", "best ms", "median ms", "spread ms", "against", "its best ms", "ratio", "at most", "met")
TORCH_VERTICES = 200_000  # the arithmetic in torch is held against ours on fewer vertices, for its memory

Row = list[str]
Call = Callable[[], object]


def main() -> None:
    """Measure, print and write the table."""
    from bench.tables import to_csv, write_text  # asv imports this module from another folder

    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("--vertices", type=int, default=500_000, help="default: %(default)s")
    parser.add_argument("--threads", type=int, default=dfd.get_num_threads(), help="default: %(default)s")
    options = parser.parse_args()
    dfd.set_num_threads(options.threads)
    torch.set_num_threads(options.threads)
    shown = Table(*COLUMNS, title=f"{options.vertices:,} vertices; ratios are of the best times")
    rows = list(lines(options.vertices))
    for row in rows:
        shown.add_row(*row)
    console = Console(width=170)
    console.print(f"{options.threads} threads, {_core.instruction_set()}")
    console.print(shown)
    OUTPUT.mkdir(parents=True, exist_ok=True)
    write_text(OUTPUT / "table.csv", to_csv(COLUMNS, rows))


def lines(vertex_count: int, torch_vertices: int = TORCH_VERTICES) -> Iterator[Row]:
    """Measure line after line."""
    made = make_input(vertex_count)
    yield from _binding(made)
    yield from _against_torch(make_input(min(torch_vertices, vertex_count)))
    yield from _posing(made)


def _binding(made: MadeInput) -> Iterator[Row]:
    compact, vertex_count = made.compact, len(made.vertices)
    outs = {count: np.empty((vertex_count, count), np.float32) for count in (1, 10, 100)}
    bind = {f"bind {count}": partial(dfd.bind, compact, made.handles(count), out=out) for count, out in outs.items()}
    distances = np.random.default_rng(0).random((10, vertex_count), dtype=np.float32)
    constrained = {"fixed": [1, 2, 3], "geodesic": distances, "locality": 2.0, "out": outs[10]}
    timings = together(
        {
            **bind,
            "bind 10 + 3 fixed + locality": partial(dfd.bind, compact, made.handles(10), **constrained),
            "reading the features": reading(compact.blocks),
            "torch's product": product(vertex_count, compact.dimensions, 100),
        },
        seconds=2.0,
        most=1000,
    )
    stored = f"bind 1 ({compact.precision}, {compact.dimensions} dimensions)"
    yield _row(timings, "bind 1", "reading the features", 1 / 0.85, stored)
    yield _row(timings, "bind 10", "bind 1")
    yield _row(timings, "bind 10 + 3 fixed + locality", "bind 1", 2.5)
    yield _row(timings, "bind 100", "torch's product", 1.0)


def _against_torch(made: MadeInput) -> Iterator[Row]:
    """Bind compact features, and those of the same width and precision as torch's."""
    features = made.features()
    size = f"{len(features):,} vertices"
    for count, most in ((1, 1 / 300), (100, 1 / 30)):
        handles, peer = made.handles(count), f"torch, D = {features.shape[1]}, float32"
        compact = f"bind {count}, {made.compact.precision}, {made.compact.dimensions} dimensions, {size}"
        full = f"bind {count}, D = {features.shape[1]}, float32, {size}"
        calls = {
            peer: torch_binding(features, handles),
            full: partial(dfd.bind, features, handles),
            compact: partial(dfd.bind, made.compact, handles),
        }
        timings = together(calls, least=3)
        yield _row(timings, compact, peer, most)
        yield _row(timings, full, peer)


def _posing(made: MadeInput) -> Iterator[Row]:
    vertices, transforms = made.vertices, made.transforms
    weights = {count: dfd.bind(made.compact, made.handles(count)) / count for count in (1, 100)}
    out, calls = np.empty_like(vertices), {"copying 28 bytes a vertex": copying(28 * len(vertices))}
    for count, some in weights.items():
        drag = dfd.Drag(vertices, some, transforms[:count], [0])
        calls[f"pose {count}"] = partial(dfd.pose, vertices, some, transforms[:count], out=out)
        calls[f"drag frame with {count} handles"] = partial(drag.pose, transforms[:1], out=out)
    calls["torch"] = torch_blending(vertices, weights[1], transforms[:1])
    try:
        calls["libigl's skinning"] = igl_blending(vertices, weights[1], transforms[:1])
    except ImportError:
        Console(stderr=True).print("libigl is not installed")
    timings = together(calls, most=2000)
    yield _row(timings, "pose 1", "copying 28 bytes a vertex", 1 / 0.8)
    yield _row(timings, "drag frame with 100 handles", "drag frame with 1 handles", 1.3)
    yield _row(timings, "pose 100", "pose 1")
    for name, most in (("torch", 1 / 200), ("libigl's skinning", 1 / 5)):
        if name in timings:
            yield _row(timings, "pose 1", name, most)


def _row(timings: Mapping[str, Timing], work: str, against: str, most: float | None = None, called: str = "") -> Row:
    """Return the row of one call held against another, which takes at most `1 / most` of its time."""
    own, other = timings[work], timings[against]
    ratio = own.best / other.best
    seconds = [f"{1e3 * each:.3f}" for each in (own.best, own.median, own.spread)]
    met = "" if most is None else "yes" if ratio <= most else "no"
    wanted = "" if most is None else f"{most:.3g}"
    return [called or work, *seconds, against, f"{1e3 * other.best:.3f}", f"{ratio:.3g}", wanted, met]


# --- peers


def torch_binding(features: Float32, handles: Int64) -> Call:
    """Return a call with the arithmetic of the public reference: rows of the distance matrix, clamped."""
    rows = torch.from_numpy(features)
    chosen = rows[torch.from_numpy(handles)]
    if len(handles) == 1:
        return lambda: (1 - torch.linalg.norm(rows - chosen, dim=1)).clamp(0, 1)
    return lambda: (1 - torch.cdist(rows, chosen)).clamp(0, 1)


def torch_blending(vertices: Float32, weights: Float32, transforms: Float64) -> Call:
    """Return a call with the arithmetic of the public reference: 4 x 4 matrices, blended and applied in batches."""
    points = torch.from_numpy(np.concatenate([vertices, np.ones((len(vertices), 1), np.float32)], axis=1))[:, :, None]
    factors, identity = torch.from_numpy(weights), torch.eye(4)
    moves = identity.repeat(len(transforms), 1, 1)
    moves[:, :3] = torch.from_numpy(transforms)

    def call() -> torch.Tensor:
        left = (1 - factors.sum(dim=1)).clamp(min=0)
        blended = left[:, None, None] * identity + (factors[:, :, None, None] * moves[None]).sum(dim=1)
        return torch.bmm(blended, points)[:, :3, 0]

    return call


def igl_blending(vertices: Float32, weights: Float32, transforms: Float64) -> Call:
    """Return the product of libigl's skinning matrix, made beforehand, with the stacked transforms."""
    import igl

    matrix = igl.lbs_matrix(vertices.astype(np.float64), np.ascontiguousarray(weights, np.float64))
    stacked = np.ascontiguousarray(transforms.transpose(0, 2, 1).reshape(-1, 3))
    return lambda: matrix @ stacked


if __name__ == "__main__":
    main()
