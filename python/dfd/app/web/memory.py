"""How much memory there is, and how much of it one session may take."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

__all__ = ["machine_memory", "session_memory"]

SHARE = 0.75  # of the machine's memory: the rest keeps the server, the browser and the system alive
CONTAINER = Path("/sys/fs/cgroup/memory.max")


def machine_memory() -> int | None:
    """Bytes of memory that this machine, or the container it is, has; None where the system does not tell."""
    told = []
    with contextlib.suppress(AttributeError, OSError, ValueError):
        told.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with contextlib.suppress(OSError, ValueError):  # "max" is no limit
        told.append(int(CONTAINER.read_text()))
    return min((size for size in told if size > 0), default=None)


def session_memory() -> int | None:
    """Bytes that one session may take where nobody says otherwise: three quarters of all; None sets no limit."""
    all_of_it = machine_memory()
    return None if all_of_it is None else int(SHARE * all_of_it)
