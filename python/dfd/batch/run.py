"""The driver of a batch: a Ray task for each shape that is not finished, then the list of records and the page.

All its state is in the folder, so it may be interrupted at any moment: the next run resumes.
"""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from dfd.batch.inputs import Shape
from dfd.batch.page import write_page
from dfd.batch.record import Cause, Record, modified, read_record, write_record
from dfd.batch.settings import BatchSettings

RETRIES = 1  # of a task whose process dies: the system may have ended it for other tasks' memory
OBJECT_STORE = 128 * 2**20  # bytes; records are small, and memory is for the tasks
# Bytes of one task: with torch, the encoder and a shape of a million faces, and without an encoder.
DISTILLING, LOOKING = int(2.5 * 2**30), int(1.5 * 2**30)


@dataclass(frozen=True)
class Resources:
    """Where tasks run, and what each may use."""

    address: str | None = None  # of a Ray cluster; None starts Ray on this machine
    workers: int | None = None  # tasks at a time on this machine; None goes by processors and memory
    threads: int = 1
    gpus: float = 0.0
    timeout: float | None = None  # seconds


def run_batch(
    shapes: Sequence[Shape],
    settings: BatchSettings,
    root: Path,
    resources: Resources,
    *,
    retry: bool = False,
    tell: Callable[[Record], object] = lambda record: None,
) -> list[Record]:
    """Process every shape that has no record in the folder `root`, and write `shapes.jsonl` and `index.html`.

    `retry` repeats what failed before; `tell` is called with each record, those of earlier runs first. Returned are the
    records in the order of `shapes`.

    Raises ValueError if Ray is not installed, or has not the resources of one task; OSError if the folder cannot be
    written, or no cluster answers.
    """
    records: dict[str, Record] = {}
    for shape in shapes:
        record = read_record(root, shape)
        if record is not None and (record.status == "done" or not retry):
            records[shape.name] = record
            tell(record)
    rest = [shape for shape in shapes if shape.name not in records]
    if rest:
        ray = _connect(resources)
        try:
            for record in _on_ray(ray, rest, settings, root, resources):
                records[record.name] = record
                tell(record)
        finally:
            ray.shutdown()
    ordered = [records[shape.name] for shape in shapes]
    write_page(root, settings.steps, ordered)
    return ordered


def import_ray() -> Any:
    """Return the module; ValueError if it is not installed."""
    try:
        import ray
    except ImportError:
        raise ValueError('`dfd batch` runs on Ray: pip install "dfd[batch]"') from None
    return ray


def _connect(resources: Resources) -> Any:
    """Join the Ray cluster at the address, or start Ray on this machine, and return the module.

    Raises ValueError if Ray is not installed; OSError if no cluster answers, or Ray cannot be started.
    """
    ray = import_ray()
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if resources.address is None:
        cpus = None if resources.workers is None else resources.workers * resources.threads
        options |= {"num_cpus": cpus, "include_dashboard": False, "object_store_memory": OBJECT_STORE}
    try:
        ray.init(address=resources.address or "local", **options)
    except Exception as error:  # Ray has no class of its own for a start that fails
        where = "on this machine" if resources.address is None else f"at {resources.address}"
        raise ConnectionError(f"Ray does not answer {where}: {type(error).__name__}: {_first_line(error)}") from None
    return ray


def _on_ray(
    ray: Any, shapes: Sequence[Shape], settings: BatchSettings, root: Path, resources: Resources
) -> Iterator[Record]:
    """The records of `shapes`, as they end."""
    there = ray.cluster_resources()
    memory = min(DISTILLING if "distill" in settings.steps else LOOKING, there.get("memory", 0.0))
    needs = {"CPU": resources.threads, "GPU": resources.gpus, "memory": memory}
    room = min(int(there.get(name, 0.0) / needed + 1e-9) for name, needed in needs.items() if needed)
    if room == 0:
        has = ", ".join(f"{there.get(name, 0.0):g} {name}" for name in ("CPU", "GPU"))
        raise ValueError(f"`--threads` and `--gpus` must be at most what Ray has, {has}")
    # `max_calls`: by default Ray starts a process for each task with a GPU, which would load the encoder anew.
    options = {"num_cpus": resources.threads, "num_gpus": resources.gpus, "memory": memory, "max_calls": 0}
    task = ray.remote(max_retries=RETRIES, **options)(_task)
    waiting, running, late = deque(shapes), dict[Any, tuple[Shape, float]](), set[Any]()
    while waiting or running:
        while waiting and len(running) < room:  # no task waits in Ray, so its time begins when it is handed out
            shape = waiting.popleft()
            running[task.remote(root, shape, settings, resources.threads)] = shape, time.monotonic()
        ended, _ = ray.wait(list(running), timeout=1.0)
        for reference in ended:
            shape, start = running.pop(reference)
            failed = partial(_failed, root, shape, time.monotonic() - start)
            try:
                yield ray.get(reference)
            except ray.exceptions.RayTaskError as error:
                if not isinstance(error.cause, OSError):
                    raise
                raise OSError(f"`--output`: {root} cannot be written: {_first_line(error.cause)}") from None
            except ray.exceptions.RayError as error:
                if reference in late:
                    yield failed("timeout", f"took longer than {resources.timeout:g} s")
                elif isinstance(error, ray.exceptions.OutOfMemoryError):
                    yield failed("memory", "its process was ended by Ray when memory ran out")
                else:
                    yield failed("crash", f"its process ended: {_first_line(error)}")
        for reference, (_, start) in running.items():
            if resources.timeout is not None and time.monotonic() - start > resources.timeout and reference not in late:
                late.add(reference)
                ray.cancel(reference, force=True)


def _failed(root: Path, shape: Shape, seconds: float, cause: Cause, message: str) -> Record:
    """The record of a shape whose process ended, after writing it."""
    record = Record(
        shape.name, shape.path, modified(shape.path), status="failed", cause=cause, message=message, seconds=seconds
    )
    write_record(root, record)
    return record


def _task(root: Path, shape: Shape, settings: BatchSettings, threads: int) -> Record:
    """One task, in a worker of Ray."""
    from dfd.batch.steps import process

    _use_threads(threads)
    return process(root, shape, settings)


@lru_cache(maxsize=1)
def _use_threads(count: int) -> None:
    """Compute on `count` threads from now on, against the environment: Ray sets OMP_NUM_THREADS by itself."""
    from threadpoolctl import threadpool_limits

    from dfd.common.threads import set_num_threads

    set_num_threads(count)
    os.environ["OMP_NUM_THREADS"] = str(count)  # torch begins with it, where something loads torch later
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(count)
    threadpool_limits(count)  # BLAS


def _first_line(error: BaseException) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)[:300]
