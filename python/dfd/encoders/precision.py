"""float32 or bfloat16: chosen once per machine by a timing, and stored in the user's cache.

Tokens of the two differ, so fields would differ if every process measured again. The choice is read without torch, so
that cached fields are found before torch is imported.
"""

from __future__ import annotations

import hashlib
import platform
import sys
import time
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast, get_args

from dfd.common.files import atomic_write, cache_directory

if TYPE_CHECKING:
    import torch

Precision = Literal["float32", "bfloat16"]

FASTER = 0.8  # of float32's time: bfloat16 must be at least this fast to justify its rounding
# Keys of /proc/cpuinfo that identify the model of a processor, on x86 and on ARM.
_CPU_KEYS = {
    *("vendor_id", "cpu family", "model", "model name", "stepping", "flags"),
    *("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision", "Features"),
}
_DEFAULT = "default"  # the device that is used when none is given


def choose_precision(device: torch.device) -> Precision:
    """Return "bfloat16" where `device` computes with it faster than with float32, else "float32".

    On a CPU the first choice is kept as long as the cache folder and the version of torch are; where the folder cannot
    be written, every process measures again.
    """
    precision: Precision = "float32"
    if device.type == "cuda":
        import torch

        precision = "bfloat16" if torch.cuda.get_device_capability(device) >= (8, 0) else "float32"
    elif device.type == "cpu":
        if saved_precision("cpu") is None:
            has = _cpu_has("avx512_bf16") or _cpu_has("amx_tile")
            precision = "bfloat16" if has and _bfloat16_pays() else "float32"
        precision = saved_precision("cpu") or precision  # another process may have been first
    _save(str(device), precision)
    return precision


def saved_precision(device: str) -> Precision | None:
    """Return the precision chosen on this machine for a device, by torch's name of it; None where none was."""
    word = _saved(device)
    return cast(Precision, word) if word in get_args(Precision) else None


def saved_device() -> str | None:
    """Return the device that torch uses on this machine by default; None where none was saved."""
    return _saved(_DEFAULT)


def save_device(device: str) -> None:
    """Save the device that torch uses on this machine by default."""
    _save(_DEFAULT, device)


def _cpu_has(feature: str) -> bool:
    """Whether torch reports that this CPU has `feature`; False if this version of torch cannot."""
    import torch

    ask = getattr(torch.cpu, f"_is_{feature}_supported", None)
    return bool(ask and ask())


@cache
def _bfloat16_pays() -> bool:
    """Whether products of the size that vision transformers are made of are clearly faster in bfloat16.

    Measured, because processors with the instructions differ fourfold in speed; in thread time, which excludes other
    programs, and with a margin larger than noise.
    """
    import torch

    from dfd.common.devices import one_thread

    def seconds(kind: torch.dtype) -> float:
        rows, columns = torch.ones(512, 384, dtype=kind), torch.ones(384, 1536, dtype=kind)
        taken = []
        for _ in range(5):
            start = time.thread_time()
            torch.mm(rows, columns)
            taken.append(time.thread_time() - start)
        return min(taken)

    with one_thread():
        return seconds(torch.bfloat16) < FASTER * seconds(torch.float32)


def _saved(what: str) -> str | None:
    try:
        return _path(what).read_text("utf-8").strip() or None
    except (OSError, ValueError):
        return None


def _save(what: str, word: str) -> None:
    if _saved(what) == word:
        return
    path = _path(what)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            temporary.write_text(word, "utf-8")


def _path(what: str) -> Path:
    return cache_directory() / "precision" / f"{_machine()}-{what.replace(':', '-')}"


@cache
def _machine() -> str:
    """What the speed of a precision depends on: the processor and the version of torch, hashed."""
    parts = "\n".join([sys.platform, platform.machine(), metadata.version("torch"), *_cpu_lines()])
    return hashlib.sha256(parts.encode()).hexdigest()[:16]


def _cpu_lines() -> list[str]:
    """The lines of /proc/cpuinfo that identify the first processor; on other systems its name."""
    try:
        first = Path("/proc/cpuinfo").read_text("utf-8").partition("\n\n")[0]
    except (OSError, ValueError):
        return [platform.processor()]
    return [line for line in first.splitlines() if line.partition(":")[0].strip() in _CPU_KEYS]
