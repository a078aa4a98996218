"""Run a batch: one task for each shape that is not finished. Then write the list of records and the web page.

A batch may be interrupted at any moment. Its folder contains its whole state, so the next run continues it.
"""

import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from dfd.batch.inputs import Shape
from dfd.batch.page import write_page
from dfd.batch.record import Cause, Record, modified, read_record, write_record
from dfd.batch.settings import BatchSettings
from dfd.common.distribution import pip_install

RETRIES = 1  # number of times that a task is repeated if its process dies, e.g. because other tasks used up the memory
OBJECT_STORE = 128 * 2**20  # bytes that Ray reserves for the results of tasks, which are small
# Bytes of memory that one task needs for a shape of a million faces. The step "distill" needs more: it loads torch.
DISTILL_MEMORY, OTHER_MEMORY = int(2.5 * 2**30), int(1.5 * 2**30)


@dataclass(frozen=True)
class Resources:
    """The machines on which tasks run, and the resources of each task."""

    address: str | None = None  # address of a Ray cluster; None starts Ray on this machine
    workers: int | None = None  # number of parallel tasks on this machine; None computes it from processors and memory
    threads: int = 1  # threads of one task
    gpus: float = 0.0  # GPUs of one task; 0.5 lets two tasks share one GPU
    timeout: float | None = None  # longest duration of one task, seconds; None sets no limit


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

    With `retry`, shapes that failed before are processed again. `tell` is called with each record; records of earlier
    runs come first. Return the records in the order of `shapes`.

    Without Ray, the tasks run in this process, one after another. Raises the error of `check_ray`, and ValueError if
    Ray has fewer resources than one task needs. Raises OSError if the folder cannot be written, or no cluster answers.
    """
    records: dict[str, Record] = {}
    for shape in shapes:
        record = read_record(root, shape)
        if record is not None and (record.status == "done" or not retry):
            records[shape.name] = record
            tell(record)
    rest = [shape for shape in shapes if shape.name not in records]
    for record in _results(rest, settings, root, resources):
        records[record.name] = record
        tell(record)
    ordered = [records[shape.name] for shape in shapes]
    write_page(root, settings.steps, ordered)
    return ordered


def check_ray(resources: Resources) -> Any:
    """Return the module `ray`, or None if Ray is not installed. Raise ValueError if `resources` then need Ray."""
    try:
        import ray
    except ImportError:
        if resources not in (Resources(), Resources(workers=1)):
            needing = "`--workers`, `--threads`, `--gpus`, `--timeout` and `--address`"
            raise ValueError(f"{needing} need Ray: {pip_install('batch')}") from None
        return None
    return ray


def _results(shapes: Sequence[Shape], settings: BatchSettings, root: Path, resources: Resources) -> Iterator[Record]:
    """Yield the records of `shapes` as their tasks end."""
    if not shapes:
        return
    if (ray := check_ray(resources)) is None:
        from dfd.batch.steps import process

        for shape in shapes:
            yield process(root, shape, settings)
        return
    _connect(ray, resources)
    try:
        yield from _on_ray(ray, shapes, settings, root, resources)
    finally:
        ray.shutdown()


def _connect(ray: Any, resources: Resources) -> None:
    """Connect to the Ray cluster at `resources.address`, or start Ray on this machine.

    Raises OSError if no cluster answers, or Ray cannot be started.
    """
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if resources.address is None:
        cpus = None if resources.workers is None else resources.workers * resources.threads
        options |= {"num_cpus": cpus, "include_dashboard": False, "object_store_memory": OBJECT_STORE}
    try:
        ray.init(address=resources.address or "local", **options)
    except Exception as error:  # Ray has no error class for a failed start
        where = "on this machine" if resources.address is None else f"at {resources.address}"
        raise ConnectionError(f"Ray does not answer {where}: {type(error).__name__}: {_first_line(error)}") from None


def _on_ray(
    ray: Any, shapes: Sequence[Shape], settings: BatchSettings, root: Path, resources: Resources
) -> Iterator[Record]:
    """Yield the records of `shapes` as their tasks end."""
    total = ray.cluster_resources()
    memory = min(DISTILL_MEMORY if "distill" in settings.steps else OTHER_MEMORY, total.get("memory", 0.0))
    needs = {"CPU": resources.threads, "GPU": resources.gpus, "memory": memory}
    most_running = min(int(total.get(name, 0.0) / needed + 1e-9) for name, needed in needs.items() if needed)
    if most_running == 0:
        has = ", ".join(f"{total.get(name, 0.0):g} {name}" for name in ("CPU", "GPU"))
        raise ValueError(f"`--threads` and `--gpus` must not be above the resources of Ray: {has}")
    # By default, Ray runs each GPU task in a new process, which would load the encoder again. `max_calls` avoids this.
    options = {"num_cpus": resources.threads, "num_gpus": resources.gpus, "memory": memory, "max_calls": 0}
    task = ray.remote(max_retries=RETRIES, **options)(_task)
    waiting, running, late = deque(shapes), dict[Any, tuple[Shape, float]](), set[Any]()
    while waiting or running:
        while waiting and len(running) < most_running:  # Ray starts each task at once, and its time limit begins
            shape = waiting.popleft()
            running[task.remote(root, shape, settings, resources.threads)] = shape, time.monotonic()
        ended, _ = ray.wait(list(running), timeout=1.0)
        for reference in ended:
            shape, start = running.pop(reference)
            try:
                yield ray.get(reference)
            except ray.exceptions.RayTaskError as error:
                if not isinstance(error.cause, OSError):
                    raise
                raise OSError(f"`--output`: {root} cannot be written: {_first_line(error.cause)}") from None
            except ray.exceptions.RayError as error:
                cause: tuple[Cause, str] = "crash", f"its process ended: {_first_line(error)}"
                if reference in late:
                    cause = "timeout", f"took longer than {resources.timeout:g} s"
                elif isinstance(error, ray.exceptions.OutOfMemoryError):
                    cause = "memory", "its process was ended by Ray when memory ran out"
                seconds = time.monotonic() - start
                record = Record(shape.name, shape.path, modified(shape.path), "failed", *cause, seconds)
                write_record(root, record)
                yield record
        for reference, (_, start) in running.items():
            if resources.timeout is not None and time.monotonic() - start > resources.timeout and reference not in late:
                late.add(reference)
                ray.cancel(reference, force=True)


def _task(root: Path, shape: Shape, settings: BatchSettings, threads: int) -> Record:
    """Process one shape in a worker process of Ray, and return its record."""
    from dfd.batch.steps import process

    _use_threads(threads)
    return process(root, shape, settings)


@lru_cache(maxsize=1)
def _use_threads(count: int) -> None:
    """Compute on `count` threads from now on, overriding OMP_NUM_THREADS, which Ray sets."""
    from threadpoolctl import threadpool_limits

    from dfd.common.threads import set_num_threads

    set_num_threads(count)
    os.environ["OMP_NUM_THREADS"] = str(count)  # torch reads it if a step loads torch later
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(count)
    threadpool_limits(count)  # BLAS


def _first_line(error: BaseException) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)[:300]
