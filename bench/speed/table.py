"""The table of targets: every line with the ceiling or the peer that it is held to, measured in turn with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

import dfd

from . import peers
from .made_input import MadeInput, make_input
from .measure import Timing, copying, measure, moving, product, reading, together


@dataclass(frozen=True)
class Line:
    """One comparison: `value` is read against `target`, which says in words what is wanted."""

    work: str
    timing: Timing
    against: str
    other: Timing | None
    value: str
    target: str = ""
    met: bool | None = None


def lines(vertex_count: int = 500_000, torch_vertices: int = 200_000) -> Iterator[Line]:
    """Measure line after line; the arithmetic in torch runs on `torch_vertices`, for its memory, and is scaled up."""
    made = make_input(vertex_count)
    outs = {count: np.empty((vertex_count, count), np.float32) for count in (1, 10, 100)}
    yield from _ceilings(made)
    yield from _binding(made, outs)
    yield from _against_torch(made, outs, torch_vertices)
    yield from _posing(made, outs)


def _bind(made: MadeInput, out: np.ndarray) -> Callable[[], object]:
    handles = made.handles(out.shape[1])
    return lambda: dfd.bind(made.compact, handles, out=out)


def _ceilings(made: MadeInput) -> Iterator[Line]:
    operations, count = product(len(made.vertices), made.compact.dimensions, 100)
    large = 1 << 29
    memory = np.ones(large // 8, np.int64)
    timings = together({"read": reading(memory), "copy": copying(large), "product": operations})
    for name in ("read", "copy"):
        yield Line(f"{name} 512 MB", timings[name], "", None, f"{large / timings[name].best / 1e9:.1f} GB/s")
    speed = count / timings["product"].best / 1e9
    yield Line("sgemm of 100 handles, torch", timings["product"], "", None, f"{speed:.0f} GFLOP/s")


def _binding(made: MadeInput, outs: dict[int, np.ndarray]) -> Iterator[Line]:
    compact, vertex_count = made.compact, len(made.vertices)
    stored = f"{compact.precision}, {compact.dimensions} dimensions"
    ten = made.handles(10)
    distances = np.random.default_rng(0).random((10, vertex_count), dtype=np.float32)
    constrained = {"fixed": [1, 2, 3], "geodesic": distances, "locality": 2.0, "out": outs[10]}
    calls = {
        "read": reading(compact.blocks),
        "1": _bind(made, outs[1]),
        "10": _bind(made, outs[10]),
        "constrained": partial(dfd.bind, compact, ten, **constrained),
        "moving": moving([compact.blocks, distances], outs[10]),
    }
    timings = together(calls, seconds=2.0, most=1000)
    reached = timings["read"].best / timings["1"].best
    yield Line(
        f"bind 1 ({stored})",
        timings["1"],
        "reading them",
        timings["read"],
        f"{reached:.0%}",
        ">= 85 %",
        reached >= 0.85,
    )
    yield _ratio("bind 10", timings["10"], "bind 1", timings["1"])
    yield _ratio("bind 10 + 3 fixed + locality", timings["constrained"], "bind 1", timings["1"], 2.5)
    megabytes = (compact.nbytes + distances.nbytes + outs[10].nbytes) / 1e6
    yield _ratio(f"moving its {megabytes:.0f} MB and no more", timings["moving"], "bind 1", timings["1"])

    operations, _ = product(vertex_count, compact.dimensions, 100)
    timings = together({"100": _bind(made, outs[100]), "product": operations}, least=5)
    yield _ratio("bind 100", timings["100"], "torch's product", timings["product"], 1.0)


def _against_torch(made: MadeInput, outs: dict[int, np.ndarray], torch_vertices: int) -> Iterator[Line]:
    features = made.features(torch_vertices)
    for count, wanted in ((1, 300), (100, 30)):
        peer = peers.torch_binding(features, np.arange(count))
        other = _scaled(measure(peer, least=3), len(made.vertices) / torch_vertices)
        own = measure(_bind(made, outs[count]))
        yield _speedup(f"bind {count}", own, f"torch, D = {features.shape[1]}", other, wanted)


def _posing(made: MadeInput, outs: dict[int, np.ndarray]) -> Iterator[Line]:
    vertices, transforms = made.vertices, made.transforms
    weights = {count: dfd.bind(made.compact, made.handles(count), out=outs[count]) for count in (1, 100)}
    weights[100] = weights[100] / 100
    out = np.empty_like(vertices)
    drags = {count: dfd.Drag(vertices, weights[count], transforms[:count], [0]) for count in (1, 100)}
    timings = together(
        {
            "copy": copying(28 * len(vertices)),
            "1": lambda: dfd.pose(vertices, weights[1], transforms[:1], out=out),
            "drag 1": lambda: drags[1].pose(transforms[:1], out=out),
            "drag 100": lambda: drags[100].pose(transforms[:1], out=out),
        },
        seconds=1.0,
        most=2000,
    )
    reached = timings["copy"].best / timings["1"].best
    yield Line(
        "pose 1",
        timings["1"],
        "copying 28 bytes a vertex",
        timings["copy"],
        f"{reached:.0%}",
        ">= 80 %",
        reached >= 0.8,
    )
    yield _ratio("drag frame with 100 handles", timings["drag 100"], "with 1", timings["drag 1"], 1.3)

    others = {"torch": (peers.torch_blending, 200), "libigl's skinning": (peers.igl_blending, 5)}
    for name, (make, wanted) in others.items():
        try:
            call = make(vertices, weights[1], transforms[:1])
        except ImportError:
            yield Line("pose 1", timings["1"], f"{name}: not installed", None, "")
            continue
        yield _speedup("pose 1", timings["1"], name, measure(call), wanted)
    hundred = together({"pose": lambda: dfd.pose(vertices, weights[100], transforms[:100], out=out)})["pose"]
    yield _ratio("pose 100", hundred, "pose 1", timings["1"])


def _scaled(timing: Timing, factor: float) -> Timing:
    return Timing(timing.best * factor, timing.median * factor, timing.spread * factor, timing.repeats)


def _ratio(work: str, timing: Timing, against: str, other: Timing, most: float | None = None) -> Line:
    ratio = timing.best / other.best
    target = "" if most is None else f"<= {most:g} x"
    return Line(work, timing, against, other, f"{ratio:.2f} x", target, None if most is None else ratio <= most)


def _speedup(work: str, timing: Timing, against: str, other: Timing, least: float) -> Line:
    factor = other.best / timing.best
    return Line(work, timing, against, other, f"{factor:.0f} x faster", f">= {least:g} x", factor >= least)
