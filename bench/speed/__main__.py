"""`python -m bench.speed`: compare the times of bind and pose with the machine's limits and with other libraries.

Compared calls run in turn. The ratio is the best time of a call divided by the best time of the other call.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import igl
import numpy as np
import torch

import dfd
import dfd._core as _core
from dfd.common.linear_algebra import Float32, Float64, Int64

from .made_input import VERTICES, Call, MadeInput, make_input
from .measure import Timing, copying, product, reading, together

COLUMNS = ("call", "best ms", "median ms", "spread ms", "other call", "its best ms", "ratio", "largest allowed", "met")
GRADIENTS = ((100_000, 1), (100_000, 100), (1_000_000, 10))  # numbers of vertices and handles, of the default size
SIZES = (0.2, 1, 2)  # numbers of vertices for a single handle, as multiples of the default size
TORCH_VERTICES = 200_000  # largest number of vertices for torch, which needs much memory

Row = list[Any]


def main() -> None:
    """Time all calls, and print the table."""
    from bench.tables import to_markdown  # asv imports this module from another folder

    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("--vertices", type=int, default=VERTICES, help="default: %(default)s")
    options = parser.parse_args()
    threads = dfd.get_num_threads()
    torch.set_num_threads(threads)
    rows = list(lines(options.vertices))
    print(f"{options.vertices:,} vertices, {threads} threads, {_core.instruction_set()}\n")
    print(to_markdown(COLUMNS, rows))


def lines(vertex_count: int, torch_vertices: int = TORCH_VERTICES) -> Iterator[Row]:
    """Yield the rows of the table; their cells are in the order of `COLUMNS`."""
    made = make_input(vertex_count)
    for size in SIZES:
        yield from _reading(make_input(int(size * vertex_count)))
    yield _against_numpy(min(torch_vertices, vertex_count))
    yield from _binding(made)
    yield from _against_torch(make_input(min(torch_vertices, vertex_count)))
    yield from _posing(made)
    for vertices, handles in GRADIENTS:
        yield from _differentiating(vertices * vertex_count // VERTICES, handles)


def _reading(made: MadeInput) -> Iterator[Row]:
    """Time bind with a single handle, compared with reading the features, compact and full."""
    full, size = made.features(TORCH_VERTICES), f"{len(made.vertices):,} vertices"
    compact = f"bind 1, {made.compact.precision}, {made.compact.dimensions} dimensions, {size}"
    wide = f"bind 1, D = {full.shape[1]}, float32, {len(full):,} vertices"
    out = np.empty((len(full), 1), np.float32)
    calls = {
        compact: made.binding(1),
        "reading the compact features": reading(made.compact.blocks),
        wide: partial(dfd.bind, full, made.handles(1), out=out),
        "reading the features": reading(full),
    }
    timings = together(calls, most=1000)
    yield _row(timings, compact, "reading the compact features", 1 / 0.8)
    yield _row(timings, wide, "reading the features", 1 / 0.8)


def _against_numpy(count: int, dimension: int = 64) -> Row:
    """Time bind with features that are not compact, and the shortest code in NumPy."""
    rows = np.random.default_rng(0).standard_normal((count, dimension), dtype=np.float32) / np.float32(8)

    def numpy() -> Float32:
        squares = np.einsum("ij,ij->i", rows, rows) + rows[0] @ rows[0] - 2 * (rows @ rows[0])
        return np.maximum(1 - np.sqrt(np.maximum(squares, 0)), 0)

    one = f"bind 1, D = {dimension}, float32, {count:,} vertices"
    return _row(together({one: partial(dfd.bind, rows, [0]), "NumPy": numpy}), one, "NumPy", 1.0)


def _binding(made: MadeInput) -> Iterator[Row]:
    constrained = "bind 10 + 3 fixed + locality"
    one = "bind 1"
    calls = {
        one: made.binding(1),
        "bind 10": made.binding(10),
        "bind 100": made.binding(100),
        constrained: made.binding(10, constrained=True),
        "torch's product": product(len(made.vertices), made.compact.dimensions, 100),
    }
    timings = together(calls, seconds=2.0, most=1000)
    yield _row(timings, "bind 10", one)
    yield _row(timings, constrained, one, 2.5)
    yield _row(timings, "bind 100", "torch's product", 1.0)


def _against_torch(made: MadeInput) -> Iterator[Row]:
    """Time bind with compact and with full features, and torch with full features."""
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
    vertices, transform = made.vertices, made.transforms[:1]
    weights = dfd.bind(made.compact, made.handles(1))
    calls = {f"pose {count}": made.pose("pose", count) for count in (1, 100)}
    calls |= {f"drag frame with {count} handles": made.pose("drag", count) for count in (1, 100)}
    calls["copying 28 bytes per vertex"] = copying(28 * len(vertices))
    calls["torch"] = torch_blending(vertices, weights, transform)
    calls["libigl's skinning"] = igl_blending(vertices, weights, transform)
    timings = together(calls, most=2000)
    yield _row(timings, "pose 1", "copying 28 bytes per vertex", 1 / 0.8)
    yield _row(timings, "drag frame with 100 handles", "drag frame with 1 handles", 1.3)
    yield _row(timings, "pose 100", "pose 1")
    yield _row(timings, "pose 1", "torch", 1 / 200)
    yield _row(timings, "pose 1", "libigl's skinning", 1 / 5)


def _differentiating(vertex_count: int, handle_count: int) -> Iterator[Row]:
    """Time a pose with its gradients, and torch with the product of weights and matrices."""
    random = np.random.default_rng(0)
    vertices = torch.from_numpy(random.standard_normal((vertex_count, 3), dtype=np.float32))
    weights = torch.from_numpy(random.random((vertex_count, handle_count), dtype=np.float32) * (1.2 / handle_count))
    moves = np.eye(3, 4) + 0.05 * random.standard_normal((handle_count, 3, 4))
    transforms = torch.from_numpy(moves.astype(np.float32)).requires_grad_()
    step = torch.from_numpy(random.standard_normal((vertex_count, 3), dtype=np.float32))
    size = f"{vertex_count:,} × {handle_count}"
    for wanted in ("transforms", "transforms and weights"):
        leaf = weights.clone().requires_grad_() if "weights" in wanted else weights
        leaves = [each for each in (transforms, leaf) if each.requires_grad]

        def derived(pose: Callable[..., Any], leaf: torch.Tensor = leaf, leaves: list[torch.Tensor] = leaves) -> object:
            return torch.autograd.grad(pose(vertices, leaf, transforms), leaves, step)

        own, peer = f"pose and gradients of {wanted}, {size}", f"torch, {size}"
        timings = together({own: partial(derived, dfd.pose), peer: partial(derived, torch_product)}, most=50)
        yield _row(timings, own, peer, 1.0 if vertex_count < 1_000_000 else 1 / 3)


def torch_product(vertices: torch.Tensor, weights: torch.Tensor, transforms: torch.Tensor) -> torch.Tensor:
    """Pose with torch by the product of the weights and the matrices, which takes less time than `torch_blending`."""
    left = (1 - weights.sum(dim=1, keepdim=True)).clamp(min=0)
    rest = torch.eye(3, 4).reshape(1, 12)
    blended = (weights @ transforms.reshape(len(transforms), 12) + left * rest).reshape(-1, 3, 4)
    return torch.einsum("vij,vj->vi", blended[:, :, :3], vertices) + blended[:, :, 3]


def _row(timings: Mapping[str, Timing], call: str, other_call: str, most: float | None = None) -> Row:
    """Return the table row that compares two calls. The ratio of their times should be at most `most`."""
    own, other = timings[call], timings[other_call]
    ratio = own.best / other.best
    milliseconds = [1e3 * each for each in (own.best, own.median, own.spread)]
    met = "" if most is None else "yes" if ratio <= most else "no"
    return [call, *milliseconds, other_call, 1e3 * other.best, ratio, most, met]


def torch_binding(features: Float32, handles: Int64) -> Call:
    """Return a call that binds with torch as the paper's public code does: 1 minus the distances, clamped."""
    rows = torch.from_numpy(features)
    chosen = rows[torch.from_numpy(handles)]
    if len(handles) == 1:
        return lambda: (1 - torch.linalg.norm(rows - chosen, dim=1)).clamp(0, 1)
    return lambda: (1 - torch.cdist(rows, chosen)).clamp(0, 1)


def torch_blending(vertices: Float32, weights: Float32, transforms: Float64) -> Call:
    """Return a call that poses with torch as the paper's public code does: batches of blended 4 x 4 matrices."""
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
    """Return a call that poses with libigl: it multiplies the skinning matrix by the stacked transforms."""
    matrix = igl.lbs_matrix(vertices.astype(np.float64), np.ascontiguousarray(weights, np.float64))
    stacked = np.ascontiguousarray(transforms.transpose(0, 2, 1).reshape(-1, 3))
    return lambda: matrix @ stacked


if __name__ == "__main__":
    main()
