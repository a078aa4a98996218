"""Workers on this machine: a process a slot, each with a pipe of its own.

The pools of the standard library break when a worker is killed: the lock of their common queue can die with it. Here
nothing is shared: a worker that dies loses one job, and the next job of its slot starts a new worker. A worker whose
driver is gone finishes its shape and exits.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Protocol

import psutil

from dfd.batch.record import Job, Limits, Record, Stopped, WorkerDied

Outcome = Record | Stopped | WorkerDied
SPAWN = multiprocessing.get_context("spawn")  # OpenMP's threads do not survive a fork


class Slots(Protocol):
    """Where jobs are done, so many at a time."""

    def free(self) -> bool:
        """Whether another job can be taken."""

    def submit(self, job: Job) -> None:
        """Begin a job."""

    def wait(self, seconds: float) -> Sequence[tuple[Job, Outcome]]:
        """The jobs that have ended, after at most so many seconds."""

    def close(self) -> None:
        """End all workers at once."""


class ProcessSlots:
    """Slots on this machine, one for each of `environments`: what its processes have in theirs besides ours."""

    def __init__(self, environments: Sequence[Mapping[str, str]]) -> None:
        self._idle = [_Slot(dict(each)) for each in environments]
        self._busy: list[_Slot] = []

    def free(self) -> bool:
        return bool(self._idle)

    def submit(self, job: Job) -> None:
        slot = self._idle.pop(0)
        slot.begin(job)
        self._busy.append(slot)

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        wait([each for slot in self._busy for each in slot.signs()], seconds)
        ended = []
        for slot in list(self._busy):
            outcome = slot.outcome()
            if outcome is not None:
                self._busy.remove(slot)
                self._idle.append(slot)
                ended.append((slot.job, outcome))
        return ended

    def close(self) -> None:
        for slot in (*self._idle, *self._busy):
            slot.end()


class _Slot:
    """Room for one process at a time."""

    job: Job

    def __init__(self, environment: dict[str, str]) -> None:
        self._environment = environment
        self._child: tuple[multiprocessing.process.BaseProcess, Connection] | None = None

    def begin(self, job: Job) -> None:
        self.job = job
        for _ in range(2):  # a worker may have been killed while it was idle
            if self._child is None or not self._child[0].is_alive():
                self.end()
                self._child = self._started()
            with contextlib.suppress(OSError):
                self._child[1].send(job)
                return

    def signs(self) -> list[Connection | int]:
        """The objects to wait for."""
        assert self._child is not None
        process, pipe = self._child
        return [pipe, process.sentinel]

    def outcome(self) -> Outcome | None:
        """The outcome of the job, or None while it runs."""
        assert self._child is not None
        process, pipe = self._child
        try:
            if pipe.poll():
                return pipe.recv()
        except (EOFError, OSError):
            process.join(5.0)
        if process.is_alive():
            return None
        code = process.exitcode
        self.end()
        return WorkerDied(how=_how(code))

    def end(self) -> None:
        if self._child is not None:
            process, pipe = self._child
            process.kill()
            process.join()
            process.close()
            pipe.close()
            self._child = None

    def _started(self) -> tuple[multiprocessing.process.BaseProcess, Connection]:
        pipe, theirs = SPAWN.Pipe()
        process = SPAWN.Process(target=_serve, args=(theirs, self._environment), daemon=True, name="dfd-batch")
        process.start()
        theirs.close()  # so that each side learns when the other is gone
        return process, pipe


def _serve(pipe: Connection, environment: Mapping[str, str]) -> None:
    """Do jobs until the driver closes the pipe, or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the driver handles Ctrl-C and ends its workers
    os.environ.update(environment)  # before anything is loaded that reads it
    from dfd.batch.worker import work

    with contextlib.suppress(EOFError, OSError):
        while True:
            pipe.send(work(pipe.recv()))


def _how(code: int | None) -> str:
    if code is not None and code < 0:
        try:
            named = signal.Signals(-code).name
        except ValueError:
            named = f"signal {-code}"
        hint = ", as the system does when memory runs out" if named == "SIGKILL" else ""
        return f"its process was ended by {named}{hint}"
    return f"its process left with code {code}"


# Bytes of one task that distills, with torch, the encoder and a shape of a million faces, and of one that does not.
DISTILLING, LOOKING = int(2.5 * 2**30), int(1.5 * 2**30)
KEPT_FREE = 0.1  # of the memory, for the system and what else runs


def processors() -> int:
    """The logical processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_memory() -> int:
    """Bytes that are free, on the machine and in the control group of a container."""
    free = int(psutil.virtual_memory().available)
    try:
        granted = Path("/sys/fs/cgroup/memory.max").read_text().strip()
        used = int(Path("/sys/fs/cgroup/memory.current").read_text())
        if granted != "max":
            free = min(free, int(granted) - used)
    except (OSError, ValueError):
        pass
    return int(free * (1 - KEPT_FREE))


def slot_environments(workers: int | None, limits: Limits, gpus: int) -> list[dict[str, str]]:
    """What each slot of this machine has in its environment: the `workers` that are wanted, or as many slots as fit.

    `gpus` is how many this machine has. Raises ValueError if not even one fits, or not as many as are wanted.
    """
    if limits.threads > processors():
        raise ValueError(f"`--threads` must be at most the {processors()} processors, got {limits.threads}")
    if limits.gpus > gpus:
        raise ValueError(f"`--gpus` must be at most the {gpus} GPUs of this machine, got {limits.gpus:g}")
    most = processors() // limits.threads
    if limits.gpus:
        most = min(most, int(gpus / limits.gpus + 1e-9))
    free = available_memory()
    if limits.memory is not None:
        fit = free // limits.memory
        if fit < (workers or 1):
            raise ValueError(
                f"`--memory`: {workers or 1} tasks of {limits.memory / 2**30:.2g} GiB do not fit into the "
                f"{free / 2**30:.2g} GiB that are free: lower `--memory` or `--workers`"
            )
        most = min(most, fit)
    count = most if workers is None else workers
    own = {"OMP_NUM_THREADS": str(limits.threads), "TOKENIZERS_PARALLELISM": "false"}
    if not limits.gpus:
        return [{**own, "CUDA_VISIBLE_DEVICES": ""} for _ in range(count)]
    return [{**own, "CUDA_VISIBLE_DEVICES": str(int(slot * limits.gpus + 1e-9) % gpus)} for slot in range(count)]
