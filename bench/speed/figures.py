"""The paper's figures on this machine: Fig. 10 (time against faces), Table 3 (rebinding), threads and handles."""

from __future__ import annotations

import csv
import io
import multiprocessing
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import dfd
from dfd.common.files import atomic_write

from .made_input import MadeInput, make_input, torus
from .measure import measure
from .peers import MESH_PEERS, torch_binding, torch_blending

__all__ = ["draw"]

PATIENCE = 120.0  # seconds after which a peer is given up
PAPER_A40 = {1: 4.0, 10: 12.0, 100: 34.0}  # ms to rebind, Table 3 of the paper
TORCH_VERTICES = 600_000  # beyond, its temporaries need too much memory
Row = tuple[str, float, float]  # series, place on the horizontal axis, milliseconds


def draw(folder: Path, largest: int, distill_faces: int) -> Iterator[Path]:
    """Measure and write each figure as CSV and PNG; meshes up to `largest` faces, fields up to `distill_faces`."""
    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "savefig.dpi": 160})
    sizes = [10**power for power in range(3, 8) if 10**power <= largest]
    yield from _write(folder / "handles", list(_handles()), "handles", "500,000 vertices")
    yield from _write(folder / "threads", list(_threads()), "threads", "500,000 vertices")
    yield from _write(folder / "table3", list(_table3()), "handles", "rebinding, 500,000 vertices")
    yield from _write(folder / "fig10", list(_fig10(sizes, distill_faces)), "faces", "time against resolution")


def _write(stem: Path, rows: list[Row], axis: str, title: str) -> Iterator[Path]:
    text = io.StringIO()
    csv.writer(text).writerows([("series", axis, "milliseconds"), *rows])
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    for name in dict.fromkeys(series for series, _, _ in rows):
        points = [(place, value) for series, place, value in rows if series == name]
        _plot(axes, name, points)
    axes.set(xscale="log", yscale="log", xlabel=axis, ylabel="milliseconds", title=title)
    axes.grid(True, which="major", color="0.9")
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    for path, write in (
        (stem.with_suffix(".csv"), lambda target: target.write_text(text.getvalue(), encoding="utf-8")),
        (stem.with_suffix(".png"), figure.savefig),
    ):
        with atomic_write(path) as target:
            write(target)
        yield path


def _plot(axes: Axes, name: str, points: list[tuple[float, float]]) -> None:
    ours = name.startswith("dfd")
    finite = [(place, value) for place, value in points if np.isfinite(value)]
    if finite:
        axes.plot(
            *zip(*finite, strict=True),
            marker="o",
            markersize=3,
            lw=2 if ours else 1,
            ls="-" if ours else "--",
            label=name,
        )
    else:
        axes.plot([], [], ls="--", color="0.7", label=f"{name}: failed")


def _milliseconds(call: Callable[[], object], seconds: float = 0.3) -> float:
    return 1e3 * measure(call, seconds=seconds, least=3).best


def _bind_call(made: MadeInput, count: int) -> Callable[[], object]:
    out = np.empty((len(made.vertices), count), np.float32)
    handles = made.handles(count)
    return lambda: dfd.bind(made.compact, handles, out=out)


def _pose_calls(made: MadeInput, count: int) -> tuple[Callable[[], object], Callable[[], object]]:
    weights = dfd.bind(made.compact, made.handles(count))
    weights /= count
    out = np.empty_like(made.vertices)
    transforms = made.transforms[:count]
    drag = dfd.Drag(made.vertices, weights, transforms, [0])
    return (
        lambda: dfd.pose(made.vertices, weights, transforms, out=out),
        lambda: drag.pose(transforms[:1], out=out),
    )


def _handles() -> Iterator[Row]:
    made = make_input(500_000)
    for count in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000):
        yield "dfd bind", count, _milliseconds(_bind_call(made, count))
        pose, drag = _pose_calls(made, count)
        yield "dfd pose", count, _milliseconds(pose)
        yield "dfd drag frame", count, _milliseconds(drag)


def _threads() -> Iterator[Row]:
    made = make_input(500_000)
    before = dfd.get_num_threads()
    try:
        for threads in range(1, before + 1):
            dfd.set_num_threads(threads)
            for count in (1, 10, 100):
                yield f"dfd bind {count}", threads, _milliseconds(_bind_call(made, count))
                yield f"dfd pose {count}", threads, _milliseconds(_pose_calls(made, count)[0])
    finally:
        dfd.set_num_threads(before)


def _table3() -> Iterator[Row]:
    made = make_input(500_000)
    features = made.features(100_000)
    for count, paper in PAPER_A40.items():
        yield "dfd", count, _milliseconds(_bind_call(made, count))
        yield "paper, A40, dataset shapes", count, paper
        torch_seconds = measure(torch_binding(features, np.arange(count)), seconds=0.5, least=2).best
        yield "torch, D = 384", count, 1e3 * torch_seconds * len(made.vertices) / len(features)


def _fig10(sizes: list[int], distill_faces: int) -> Iterator[Row]:
    alive = dict.fromkeys(MESH_PEERS, True)
    for faces in sizes:
        made = make_input(faces // 2)
        yield "dfd bind 1", faces, _milliseconds(_bind_call(made, 1))
        pose, _ = _pose_calls(made, 1)
        yield "dfd pose 1", faces, _milliseconds(pose)
        if faces // 2 <= TORCH_VERTICES:
            yield "torch bind", faces, _milliseconds(torch_binding(made.features(), np.arange(1)))
            weights = dfd.bind(made.compact, [0])
            yield "torch pose", faces, _milliseconds(torch_blending(made.vertices, weights, made.transforms[:1]))
        if faces <= distill_faces:
            mesh = dfd.Mesh(*torus(faces))
            start = time.perf_counter()
            dfd.compact(dfd.distill(mesh, progress=False, cache=False).on(mesh))
            yield "dfd preprocess", faces, 1e3 * (time.perf_counter() - start)
        for name in [name for name, still in alive.items() if still]:
            results = _in_a_process(name, faces)
            alive[name] = bool(results)  # what fails or takes too long will not do better on a larger mesh
            for stage, value in (results or {"": float("nan")}).items():
                yield f"{name} {stage}".strip(), faces, value


def _in_a_process(name: str, faces: int) -> dict[str, float]:
    """Milliseconds of every stage of a peer, run where it may crash or hang; empty if it did."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_run_peer, args=(sender, name, faces), daemon=True)
    process.start()
    sender.close()
    try:
        return dict(receiver.recv()) if receiver.poll(PATIENCE) else {}
    except EOFError:
        return {}
    finally:
        process.kill()
        process.join()


def _run_peer(sender: Connection, name: str, faces: int) -> None:
    vertices, triangles = torus(faces)
    stages: dict[str, float] = {}
    try:
        for stage, call in MESH_PEERS[name](vertices, triangles).items():
            start = time.perf_counter()
            call()
            stages[stage] = 1e3 * (time.perf_counter() - start)
    except ImportError:
        stages = {}
    sender.send(stages)
