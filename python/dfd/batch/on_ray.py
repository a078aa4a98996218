"""The same workers on a Ray cluster, which decides where and when each job runs."""

from __future__ import annotations

import socket
from typing import Any

from dfd.batch.pool import Outcome
from dfd.batch.record import Job, Limits, WorkerDied
from dfd.batch.worker import work

PATIENCE = 5.0  # seconds to wait for a cluster's answer
QUEUED = 2  # jobs for each slot of the cluster, so that none idles


def connect(address: str | None, workers: int | None, threads: int) -> Any:
    """Start Ray on this machine, or join the cluster at `address`, and return the module.

    Raises ValueError if Ray is not installed, or the address is none; OSError if no cluster answers there.
    """
    try:
        import ray
    except ImportError:
        raise ValueError("`--ray` needs Ray: pip install 'dfd[batch]'") from None
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
    if address is None:
        cpus = None if workers is None else workers * threads
        try:
            ray.init(address="local", num_cpus=cpus, include_dashboard=False, **options)
        except Exception as error:  # Ray has no class of its own for a start that takes too long
            raise ConnectionError(f"`--ray`: Ray could not be started here: {_first_line(error)}") from None
        return ray
    if address != "auto":
        _answers(address)
    try:
        ray.init(address=address, **options)
    except Exception as error:
        reason = _first_line(error)
        raise ConnectionError(f"`--ray-address`: no Ray cluster answers at {address}: {reason}") from None
    return ray


def _answers(address: str) -> None:
    """Refuse an address that does not answer: Ray itself would retry for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"`--ray-address` must be auto, HOST:PORT or ray://HOST:PORT, got {address!r}")
    try:
        socket.create_connection((host, int(port)), PATIENCE).close()
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConnectionError(f"`--ray-address`: no Ray cluster answers at {address}: {reason}") from None


class RaySlots:
    """Slots on a Ray cluster: `ray` is the module, connected. A task is started when what `limits` reserve is free."""

    def __init__(self, ray: Any, limits: Limits) -> None:
        self._ray, self._limits = ray, limits
        promised: dict[str, Any] = {"num_cpus": limits.threads, "num_gpus": limits.gpus, "max_retries": 0}
        promised["max_calls"] = 0  # with a GPU, Ray would start a process a task, and load the encoder in each
        if limits.memory is not None:
            promised["memory"] = limits.memory
        self._check(promised)
        self._task = ray.remote(**promised)(work)
        self._running: dict[Any, Job] = {}

    def free(self) -> bool:
        """Whether another job can be taken: the cluster may have grown since the last one."""
        cpus = self._ray.cluster_resources().get("CPU", 1.0)
        return len(self._running) < QUEUED * max(1, int(cpus // self._limits.threads))

    def submit(self, job: Job) -> None:
        self._running[self._task.remote(job)] = job

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        ended, _ = self._ray.wait(list(self._running), timeout=seconds)
        found = []
        for reference in ended:
            job = self._running.pop(reference)
            try:
                found.append((job, self._ray.get(reference)))
            except self._ray.exceptions.RayError as error:
                found.append((job, WorkerDied(how=f"its process ended: {_first_line(error)}")))
        return found

    def close(self) -> None:
        """End what runs, and leave the cluster."""
        for reference in self._running:
            self._ray.cancel(reference, force=True)
        self._ray.shutdown()

    def _check(self, promised: dict[str, Any]) -> None:
        """Refuse requirements that the cluster never meets: Ray would wait forever.

        Raises ValueError if one task needs more than all of it.
        """
        there = self._ray.cluster_resources()
        for name, key in (("threads", "CPU"), ("gpus", "GPU"), ("memory", "memory")):
            needed = getattr(self._limits, name) or 0
            if needed > there.get(key, 0):
                raise ValueError(
                    f"`--{name}` must be at most what the Ray cluster has, {there.get(key, 0):g}, got {needed:g}"
                )


def _first_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[0] if lines else ''}"[:300]
