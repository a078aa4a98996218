"""How many tasks this machine holds at a time."""

from __future__ import annotations

import os
from pathlib import Path

import psutil

from dfd.batch.record import Limits

__all__ = ["DISTILLING", "LOOKING", "available_memory", "processors", "slot_environments"]

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
    """What each slot of this machine has in its environment: as many slots as fit, or the `workers` that are wanted.

    Parameters
    ----------
    workers
        None takes as many as processors, memory and GPUs allow.
    gpus
        How many this machine has.

    Raises
    ------
    ValueError
        If not even one fits, or not as many as are wanted.
    """
    if limits.threads > processors():
        raise ValueError(f"batch: `threads` must be at most the {processors()} processors, got {limits.threads}")
    if limits.gpus > gpus:
        raise ValueError(f"batch: `gpus` must be at most the {gpus} GPUs of this machine, got {limits.gpus:g}")
    most = processors() // limits.threads
    if limits.gpus:
        most = min(most, int(gpus / limits.gpus + 1e-9))
    free = available_memory()
    if limits.memory is not None:
        fit = free // limits.memory
        if fit < (workers or 1):
            raise ValueError(
                f"batch: `memory`: {workers or 1} tasks of {limits.memory / 2**30:.2g} GiB do not fit into the "
                f"{free / 2**30:.2g} GiB that are free: lower `memory` or `workers`"
            )
        most = min(most, fit)
    count = most if workers is None else workers
    own = {"OMP_NUM_THREADS": str(limits.threads), "TOKENIZERS_PARALLELISM": "false"}
    if not limits.gpus:
        return [{**own, "CUDA_VISIBLE_DEVICES": ""} for _ in range(count)]
    return [{**own, "CUDA_VISIBLE_DEVICES": str(int(slot * limits.gpus + 1e-9) % gpus)} for slot in range(count)]
