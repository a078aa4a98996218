"""`python -m bench.batch`: 300 shapes, 20 of them bad, a worker killed on the way, on the pool and on Ray.

Then good shapes alone, for the share of the workers' time that is none of the shapes' own. Prints what became of all of
them and whether both tables are equal; exits with 1 if they differ or a shape is missing.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

from pyarrow import parquet

from bench.batch.made_shapes import HANGS, HOGS, KILLED, make
from dfd.batch.folder import BatchFolder
from dfd.batch.inputs import Shape, find_shapes
from dfd.batch.on_ray import RaySlots, connect
from dfd.batch.pool import ProcessSlots, Slots, slot_environments
from dfd.batch.record import Limits, Record
from dfd.batch.run import run_batch
from dfd.batch.settings import BatchSettings

WORKERS = 2
# What is the same wherever and whenever a shape is done.
SAME = ("name", "status", "cause", "sha256", "size", "vertices", "faces", "components", "feature_dimensions", "files")


class Times:
    """Notes when shapes end, and how long each took by itself."""

    def __init__(self) -> None:
        self.spans: list[tuple[float, float]] = []

    def begun(self, total: int, finished: int) -> None:
        """Say so."""
        print(f"  {total} shapes, {finished} finished before", flush=True)

    def ended(self, record: Record) -> None:
        """Note one."""
        now = time.perf_counter()
        self.spans.append((now - record.seconds, now))
        if len(self.spans) % 50 == 0:
            print(f"  {len(self.spans)}", flush=True)

    def looked(self) -> None:
        """Nothing to do."""

    def overhead(self) -> float:
        """The share of the workers' time, from the first shape's begin to the last one's end, that was no shape's."""
        first, last = min(begin for begin, _ in self.spans), max(end for _, end in self.spans)
        return 1 - sum(end - begin for begin, end in self.spans) / (WORKERS * (last - first))


class Killer(threading.Thread):
    """Kills one worker after `after` shapes, and whichever has the shape that no worker survives."""

    def __init__(self, root: Path, after: int) -> None:
        super().__init__(daemon=True)
        self.root, self.after = root, after
        self.killed: list[str] = []

    def run(self) -> None:
        """Look, twenty times a second."""
        once = False
        while (self.root / ".work").is_dir() or not self.killed:
            time.sleep(0.05)
            for owner in self.root.glob(".work/*~*/owner"):
                name = owner.parent.name.partition("~")[0]
                special = name in (HANGS, HOGS)
                wanted = not once and not special and len(list((self.root / "shapes").glob("*"))) >= self.after
                if name == KILLED or wanted:
                    try:
                        os.kill(int(owner.read_text().split()[0]), signal.SIGKILL)
                    except (OSError, ValueError, IndexError):
                        continue
                    once |= name != KILLED
                    self.killed.append(name)
                    time.sleep(0.5)


def run(root: Path, shapes: list[Shape], slots: Slots, limits: Limits, trouble: bool) -> None:
    """Work through shapes, and print what became of them."""
    settings = BatchSettings(steps=("inspect", "features", "pictures"))
    folder, times, killer = BatchFolder.begin(root, settings), Times(), Killer(root, after=60)
    if trouble:
        killer.start()
    try:
        summary = run_batch(shapes, settings, folder, slots, limits, times)
    finally:
        slots.close()
    print(
        f"  {summary.done} done, {dict(summary.causes)}, {summary.missing} missing; killed {killer.killed}\n"
        f"  {summary.seconds:.1f} s, shapes' own {summary.busy:.1f} s on {WORKERS} workers, "
        f"overhead {times.overhead():.1%} (load average {os.getloadavg()[0]:.1f})",
        flush=True,
    )


def compared(folder: Path, shapes: list[Shape], limits: Limits, on: list[str], trouble: bool) -> bool:
    """Run on the pool, on Ray or on both, and say whether the tables are equal and whole."""
    tables = []
    for name in on:
        root = folder / f"{name}-{'trouble' if trouble else 'calm'}"
        print(root.name, flush=True)
        slots: Slots
        if name == "pool":
            slots = ProcessSlots(slot_environments(WORKERS, limits, 0))
        else:
            slots = RaySlots(connect(None, WORKERS, 1), limits)
        run(root, shapes, slots, limits, trouble)
        tables.append(parquet.read_table(root / "shapes.parquet", columns=list(SAME)).to_pylist())
    different = [a["name"] for a, b in zip(tables[0], tables[-1], strict=True) if a != b]
    print(f"tables: {len(tables[0])} rows each, {len(different)} of them different {different[:5]}", flush=True)
    return not different and len(tables[0]) == len(shapes)


def main() -> None:
    """Run all, and leave with 1 if anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shapes", type=int, default=300, help="with the twenty bad ones; 0 leaves this part out")
    parser.add_argument("--calm", type=int, default=60, help="good ones, and no worker is killed: for the overhead")
    parser.add_argument("--on", nargs="+", choices=("pool", "ray"), default=["pool", "ray"])
    parser.add_argument("--folder", type=Path, help="keep everything here")
    asked = parser.parse_args()
    folder = asked.folder or Path(tempfile.mkdtemp())
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    shapes = find_shapes([str(make(folder / "shapes", max(asked.shapes, asked.calm + 20)))])
    good = [shape for shape in shapes if not shape.name.startswith("bad-")]
    limits = Limits(threads=1, timeout=30.0, memory=int(1.2 * 2**30))
    whole = [compared(folder, shapes, limits, asked.on, trouble=True)] if asked.shapes else []
    whole += [compared(folder, good[: asked.calm], limits, asked.on, trouble=False)] if asked.calm else []
    if asked.folder is None:
        shutil.rmtree(folder)
    sys.exit(not all(whole))


if __name__ == "__main__":
    main()
