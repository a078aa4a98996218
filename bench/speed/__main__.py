"""`python -m bench.speed`: kernels against the machine's ceilings and other libraries.

Every line is measured in turn with the ceiling or the peer that it is held to, and written to bench/results/speed.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

import dfd
import dfd._core as _core
from dfd.common.linear_algebra import Float32, Float64, Int64

from .made_input import MadeInput, make_input
from .measure import Timing, copying, measure, moving, product, reading, together

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "speed"
COLUMNS = ("work", "best ms", "median ms", "spread ms", "against", "its best ms", "ratio", "target", "met")
TORCH_VERTICES = 200_000  # the arithmetic in torch runs on fewer vertices, for its memory, and is scaled up

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
    if options.threads != int(os.environ.get("OPENBLAS_NUM_THREADS", 0)):  # NumPy's products read it once, at start
        os.environ["OPENBLAS_NUM_THREADS"] = str(options.threads)
        os.execv(sys.executable, [sys.executable, "-m", "bench.speed", *sys.argv[1:]])
    OUTPUT.mkdir(parents=True, exist_ok=True)
    console = Console(width=170)
    console.print(f"{options.threads} threads, {_core.instruction_set()}")
    shown = Table(*COLUMNS, title=f"{options.vertices:,} vertices; ratios are of the best times")
    rows = list(lines(options.vertices))
    for row in rows:
        shown.add_row(*row)
    console.print(shown)
    write_text(OUTPUT / "table.csv", to_csv(COLUMNS, rows))


def lines(vertex_count: int, torch_vertices: int = TORCH_VERTICES) -> Iterator[Row]:
    """Measure line after line."""
    made = make_input(vertex_count)
    outs = {count: np.empty((vertex_count, count), np.float32) for count in (1, 10, 100)}
    yield from _ceilings(made)
    yield from _binding(made, outs)
    yield from _against_torch(made, outs, min(torch_vertices, vertex_count))
    yield from _posing(made, outs)


def _bind(made: MadeInput, out: Float32) -> Call:
    return partial(dfd.bind, made.compact, made.handles(out.shape[1]), out=out)


def _ceilings(made: MadeInput) -> Iterator[Row]:
    operations, count = product(len(made.vertices), made.compact.dimensions, 100)
    large = 1 << 29
    timings = together({"read": reading(np.ones(large // 8, np.int64)), "copy": copying(large), "product": operations})
    for name in ("read", "copy"):
        yield _row(f"{name} 512 MB", timings[name], value=f"{large / timings[name].best / 1e9:.1f} GB/s")
    speed = count / timings["product"].best / 1e9
    yield _row("sgemm of 100 handles, torch", timings["product"], value=f"{speed:.0f} GFLOP/s")


def _binding(made: MadeInput, outs: dict[int, Float32]) -> Iterator[Row]:
    compact, vertex_count = made.compact, len(made.vertices)
    distances = np.random.default_rng(0).random((10, vertex_count), dtype=np.float32)
    constrained = {"fixed": [1, 2, 3], "geodesic": distances, "locality": 2.0, "out": outs[10]}
    calls = {
        "read": reading(compact.blocks),
        "1": _bind(made, outs[1]),
        "10": _bind(made, outs[10]),
        "constrained": partial(dfd.bind, compact, made.handles(10), **constrained),
        "moving": moving([compact.blocks, distances], outs[10]),
    }
    timings = together(calls, seconds=2.0, most=1000)
    stored = f"bind 1 ({compact.precision}, {compact.dimensions} dimensions)"
    yield _reached(stored, timings["1"], "reading them", timings["read"], 0.85)
    yield _ratio("bind 10", timings["10"], "bind 1", timings["1"])
    yield _ratio("bind 10 + 3 fixed + locality", timings["constrained"], "bind 1", timings["1"], 2.5)
    megabytes = (compact.nbytes + distances.nbytes + outs[10].nbytes) / 1e6
    yield _ratio(f"moving its {megabytes:.0f} MB and no more", timings["moving"], "bind 1", timings["1"])
    operations, _ = product(vertex_count, compact.dimensions, 100)
    timings = together({"100": _bind(made, outs[100]), "product": operations}, least=5)
    yield _ratio("bind 100", timings["100"], "torch's product", timings["product"], 1.0)


def _against_torch(made: MadeInput, outs: dict[int, Float32], torch_vertices: int) -> Iterator[Row]:
    features = made.features(torch_vertices)
    for count, wanted in ((1, 300), (100, 30)):
        handles = np.arange(count)
        timings = together(
            {"torch": torch_binding(features, handles), "full": partial(dfd.bind, features, handles)}, least=3
        )
        name = f"torch, D = {features.shape[1]}, float32"
        other = timings["torch"].scaled(len(made.vertices) / torch_vertices)
        yield _speedup(f"bind {count}", measure(_bind(made, outs[count])), name, other, wanted)
        own = timings["full"].scaled(len(made.vertices) / torch_vertices)
        yield _speedup(f"bind {count}, the same features", own, name, other)


def _posing(made: MadeInput, outs: dict[int, Float32]) -> Iterator[Row]:
    vertices, transforms = made.vertices, made.transforms
    weights = {count: dfd.bind(made.compact, made.handles(count), out=outs[count]) for count in (1, 100)}
    weights[100] = weights[100] / 100
    out = np.empty_like(vertices)
    drags = {count: dfd.Drag(vertices, weights[count], transforms[:count], [0]) for count in (1, 100)}
    calls = {
        "copy": copying(28 * len(vertices)),
        "1": partial(dfd.pose, vertices, weights[1], transforms[:1], out=out),
        "100": partial(dfd.pose, vertices, weights[100], transforms[:100], out=out),
        **{f"drag {count}": partial(drag.pose, transforms[:1], out=out) for count, drag in drags.items()},
    }
    timings = together(calls, most=2000)
    yield _reached("pose 1", timings["1"], "copying 28 bytes a vertex", timings["copy"], 0.8)
    yield _ratio("drag frame with 100 handles", timings["drag 100"], "with 1", timings["drag 1"], 1.3)
    yield _ratio("pose 100", timings["100"], "pose 1", timings["1"])
    for name, make, wanted in (("torch", torch_blending, 200), ("libigl's skinning", igl_blending, 5)):
        try:
            call = make(vertices, weights[1], transforms[:1])
        except ImportError:
            yield _row("pose 1", timings["1"], f"{name}: not installed")
        else:
            yield _speedup("pose 1", timings["1"], name, measure(call), wanted)


# --- rows


def _row(
    work: str, timing: Timing, against: str = "", other: Timing | None = None, value: str = "", *wanted: Any
) -> Row:
    target, met = wanted or ("", None)
    times = [f"{1e3 * seconds:.3f}" for seconds in (timing.best, timing.median, timing.spread)]
    best = "" if other is None else f"{1e3 * other.best:.3f}"
    return [work, *times, against, best, value, target, {None: "", True: "yes", False: "no"}[met]]


def _reached(work: str, timing: Timing, against: str, ceiling: Timing, least: float) -> Row:
    share = ceiling.best / timing.best
    return _row(work, timing, against, ceiling, f"{share:.0%}", f">= {least:.0%}", share >= least)


def _ratio(work: str, timing: Timing, against: str, other: Timing, most: float | None = None) -> Row:
    ratio = timing.best / other.best
    wanted = ("", None) if most is None else (f"<= {most:g} x", ratio <= most)
    return _row(work, timing, against, other, f"{ratio:.2f} x", *wanted)


def _speedup(work: str, timing: Timing, against: str, other: Timing, least: float | None = None) -> Row:
    factor = other.best / timing.best
    wanted = ("", None) if least is None else (f">= {least:g} x", factor >= least)
    return _row(work, timing, against, other, f"{factor:.0f} x faster", *wanted)


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
