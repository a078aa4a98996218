"""`python -m bench.speed.session`: time the steps of a session that make a user wait, for several mesh sizes.

The mesh is a quadruped, subdivided to each size. A separate process for each size measures its peak memory.
"""

import argparse
import multiprocessing
import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from trimesh.remesh import subdivide

import dfd

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "speed"
STEPS = (
    "features",
    "first handle",
    "first frame",
    "later frame",
    "second handle",
    "second handle's frame",
    "fit",
    "memory",
)
SIZES = (10_000, 100_000, 1_000_000)
TARGETS = 20  # number of vertices with target positions in a fit of four handles
LATER = 20  # number of frames after the first; "later frame" is the median of their times

Row = dict[str, float]


def field() -> dfd.Field:
    """Return a quadruped's field, made from few small pictures, because the times do not depend on its quality."""
    return dfd.distill(dfd.samples.quadruped(10_000).mesh, cache=False, views=6, resolution=224, steps=100)


def shape(vertex_count: int) -> dfd.Mesh:
    """Return the quadruped with at least `vertex_count` vertices."""
    mesh = dfd.samples.quadruped(min(max(2 * vertex_count, 4_000), 10_000)).mesh
    vertices, faces = mesh.vertices, mesh.faces
    while len(vertices) < vertex_count:
        vertices, faces = subdivide(vertices, faces)
    return dfd.Mesh(vertices, faces)


def steps(vertex_count: int, of_shape: dfd.Field) -> Row:
    """Return the seconds of each of `STEPS` in a session; "memory" is the peak minus the memory at the start, in GB."""
    mesh = shape(vertex_count)
    before = _resident()
    session = dfd.Deformer(mesh, of_shape, other_shape=True)
    foot, head = int(mesh.vertices[:, 1].argmin()), int(mesh.vertices[:, 2].argmax())
    seconds = {"vertices": float(len(mesh.vertices)), "features": _timed(session.prepare)}
    for handle, vertex, prefix in ((1, foot, "first "), (2, head, "second ")):
        seconds[f"{prefix}handle"] = _timed(lambda vertex=vertex: (session.add(vertex), session.weights))
        frames = []
        for k in range(1 + LATER):
            session.move(handle, translation=(0.0, -0.01 * (k + 1), 0.0))
            frames.append(_timed(lambda: session.vertices))
        seconds["first frame" if handle == 1 else "second handle's frame"] = frames[0]
        seconds["later frame"] = float(np.median(frames[1:]))
    for vertex in (mesh.vertices[:, 0].argmax(), mesh.vertices[:, 2].argmin()):
        session.add(int(vertex))
    marks = np.argsort(-session.following, axis=0)[: TARGETS // 4].ravel()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # some motions are not determined
        seconds["fit"] = _timed(lambda: session.fit((marks, mesh.vertices[marks] + 0.02 * mesh.diagonal)))
    return seconds | {"memory": _resident("VmHWM") - before}


def measured(vertex_count: int, of_shape: dfd.Field) -> Row:
    """Return the result of `steps`, run in a separate process."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(steps, (vertex_count, of_shape))


def _timed(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def _resident(key: str = "VmRSS") -> float:
    """Return the memory of this process in GB, now or at its peak ("VmHWM"); NaN on systems other than Linux."""
    status = Path("/proc/self/status")  # the module `resource` would include the peak of the parent process
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1e6 for line in lines if line.startswith(key)), float("nan"))


class Session:
    """Benchmark for asv: one session for each size, with the seconds of each step and the GB of memory."""

    params = (SIZES, STEPS)
    param_names = ("vertices", "step")
    timeout = 600

    def setup_cache(self) -> dict[int, Row]:
        """Measure each size once."""
        os.environ.setdefault("HF_HUB_OFFLINE", "1")  # use the installed encoder
        of_shape = field()
        return {count: measured(count, of_shape) for count in SIZES}

    def track_session(self, found: dict[int, Row], vertices: int, step: str) -> float:
        """Return the seconds of the step, or the GB of memory."""
        return found[vertices][step]


def main() -> None:
    """Measure all sizes, print a table and draw a plot."""
    from bench.tables import to_markdown  # asv imports this module from another folder

    parser = argparse.ArgumentParser(prog="python -m bench.speed.session", description=__doc__)
    parser.add_argument("--vertices", type=int, nargs="+", default=SIZES, help="default: %(default)s")
    options = parser.parse_args()
    of_shape = field()
    rows = [measured(count, of_shape) for count in options.vertices]
    columns = ["vertices", *(f"{step}, {'GB' if step == 'memory' else 's'}" for step in STEPS)]
    print(to_markdown(columns, [[int(row["vertices"]), *(row[step] for step in STEPS)] for row in rows]))
    OUTPUT.mkdir(parents=True, exist_ok=True)
    import matplotlib.pyplot as plt  # the tests run without matplotlib

    _, axes = plt.subplots(figsize=(7, 5))
    for step in STEPS[:-1]:
        axes.loglog([row["vertices"] for row in rows], [row[step] for row in rows], "o-", label=step)
    axes.set(xlabel="vertices", ylabel="seconds")
    axes.legend()
    plt.savefig(OUTPUT / "session.png", dpi=120, bbox_inches="tight")
    print(OUTPUT / "session.png")


if __name__ == "__main__":
    main()
