"""float32 or bfloat16: decided once per machine and noted in the user's cache, for a stopwatch has a say in it.

Where our own kernels compute and the processor has no tiles of bfloat16 (AMX), none is asked: with the vectors of
bfloat16 that it may have, torch takes twice the time that the kernels take with float32.

Tokens of the two differ, so fields would as well if every process measured anew. What was noted is read without torch:
that a field was made before is then known before torch is loaded.
"""

from __future__ import annotations

import hashlib
import os
import platform
import secrets
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast, get_args

from dfd.common.cache import cache_directory

if TYPE_CHECKING:
    import torch

__all__ = [
    "Precision",
    "choose_precision",
    "cpu_has",
    "kernels_are_fastest",
    "note_device",
    "note_kernels",
    "noted_device",
    "noted_precision",
]

Precision = Literal["float32", "bfloat16"]

FASTER = 0.8  # of float32's time, for bfloat16 to be worth what it rounds off
# What tells processors apart, by the names that Linux has for it on Intel's and on ARM's.
_CPU_KEYS = {
    *("vendor_id", "cpu family", "model", "model name", "stepping", "flags"),
    *("CPU implementer", "CPU architecture", "CPU variant", "CPU part", "CPU revision", "Features"),
}
_DEFAULT = "default"  # the note of the device that is taken when nobody names one


def choose_precision(device: torch.device) -> Precision:
    """Return "bfloat16" where `device` computes with it faster than with float32, else "float32".

    For a processor the first answer on a machine stands, as long as the cache folder is there and torch is the same;
    where the folder cannot be written, every process decides for itself.
    """
    if device.type != "cpu":
        precision = _of_accelerator(device)
        _note(str(device), precision)
        return precision
    noted = noted_precision("cpu")
    if noted is not None:
        return noted
    precision = _of_processor()
    _note_first("cpu", precision)
    return noted_precision("cpu") or precision


def noted_precision(device: str, weights: str | None = None) -> Precision | None:
    """Return what was chosen on this machine for a device, by torch's name of it; None where nothing was.

    `weights`: for those of this fingerprint, which our kernels may compute with, whatever torch computes with.
    """
    words = [_noted(_of_kernels(weights))] if weights and device == "cpu" else []
    known = [word for word in [*words, _noted(device)] if word in get_args(Precision)]
    return cast(Precision, known[0]) if known else None


def kernels_are_fastest() -> bool:
    """Whether it is sure, without asking torch, that nothing on this processor is faster than our kernels.

    Where they know a network, that is.
    """
    flags = next((line for line in _cpu_lines() if line.startswith("flags")), "")
    return " avx2 " in f"{flags} " and " amx_bf16 " not in f"{flags} "


def note_kernels(weights: str) -> None:
    """Note that our kernels, which take float32, compute on this machine with the weights of a fingerprint."""
    _note(_of_kernels(weights), "float32")


def _of_kernels(weights: str) -> str:
    return f"kernels-{hashlib.sha256(weights.encode()).hexdigest()[:16]}"


def noted_device() -> str | None:
    """Return where torch computes on this machine when nobody says where; None where that was not noted."""
    return _noted(_DEFAULT)


def note_device(device: str) -> None:
    """Note where torch computes on this machine when nobody says where."""
    _note(_DEFAULT, device)


def cpu_has(feature: str) -> bool:
    """Whether torch says that this CPU has `feature`; False where this version of torch does not tell."""
    import torch

    ask = getattr(torch.cpu, f"_is_{feature}_supported", None)
    return bool(ask and ask())


def _of_accelerator(device: torch.device) -> Precision:
    import torch

    modern = device.type == "cuda" and torch.cuda.get_device_capability(device) >= (8, 0)
    return "bfloat16" if modern else "float32"


def _of_processor() -> Precision:
    has = cpu_has("avx512_bf16") or cpu_has("amx_tile")
    return "bfloat16" if has and _bfloat16_pays() else "float32"


@cache
def _bfloat16_pays() -> bool:
    """Whether products of the size that vision transformers are made of are clearly faster in bfloat16.

    Processors that have the instructions differ fourfold in what they make of them, so this is measured: by the
    thread's own time, which other programs do not count in, and to a margin that chance does not bridge.
    """
    import torch

    from dfd.common.torch_threads import one_thread

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


def _noted(what: str) -> str | None:
    try:
        return _path(what).read_text("utf-8").strip() or None
    except (OSError, ValueError):
        return None


def _note(what: str, word: str) -> None:
    """Write `word` down, instead of what was noted before."""
    if _noted(what) != word:
        with suppress(OSError), _written(what, word) as note:
            note.replace(_path(what))


def _note_first(what: str, word: str) -> None:
    """Write `word` down unless another process was first, and its decision stands."""
    path = _path(what)
    with suppress(OSError), _written(what, word) as note:
        if noted_precision(what) is None:
            path.unlink(missing_ok=True)  # damaged
        try:
            os.link(note, path)  # which fails where there is one
        except FileExistsError:
            pass
        except OSError:  # a file system without links
            note.replace(path)


@contextmanager
def _written(what: str, word: str) -> Iterator[Path]:
    """A file beside the note, with its content."""
    path = _path(what)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        temporary.write_text(word, "utf-8")
        yield temporary
    finally:
        temporary.unlink(missing_ok=True)


def _path(what: str) -> Path:
    return cache_directory() / "precision" / f"{_machine()}-{what.replace(':', '-')}"


@cache
def _machine() -> str:
    """What the speed of a precision depends on: the processor and the version of torch, hashed."""
    told = "\n".join([sys.platform, platform.machine(), metadata.version("torch"), *_cpu_lines()])
    return hashlib.sha256(told.encode()).hexdigest()[:16]


def _cpu_lines() -> list[str]:
    """What tells the first of the processors apart, as Linux has it; elsewhere its name."""
    try:
        first = Path("/proc/cpuinfo").read_text("utf-8").partition("\n\n")[0]
    except (OSError, ValueError):
        return [platform.processor()]
    return [line for line in first.splitlines() if line.partition(":")[0].strip() in _CPU_KEYS]
