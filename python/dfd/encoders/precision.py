"""Choose float32 or bfloat16 for a device; torch, which takes seconds to import, is not imported for a CPU."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import torch

Precision = Literal["float32", "bfloat16"]

# Flags in /proc/cpuinfo for instructions with which torch multiplies bfloat16 matrices at least twice as fast as
# float32 matrices.
BFLOAT16_FLAGS = {"avx512_bf16", "amx_bf16"}
# Files of the drivers whose devices torch calls "cuda": NVIDIA, AMD, and Windows Subsystem for Linux.
GPU_DRIVERS = ("/proc/driver/nvidia", "/dev/kfd", "/dev/dxg")


def choose_precision(device: str | torch.device) -> Precision:
    """Return "bfloat16" if `device` has instructions for bfloat16 products, else "float32"."""
    kind = str(device).partition(":")[0]
    if kind == "cuda":
        import torch

        return "bfloat16" if torch.cuda.get_device_capability(device) >= (8, 0) else "float32"
    return "bfloat16" if kind == "cpu" and BFLOAT16_FLAGS & _cpu_flags() else "float32"


def default_device() -> str:
    """Return the device that dfd uses by default; torch is imported only if the machine may have a GPU."""
    if sys.platform == "darwin" or (sys.platform == "linux" and not any(Path(each).exists() for each in GPU_DRIVERS)):
        return "cpu"
    from dfd.common.devices import choose_device

    return str(choose_device("default_device", None))


@cache
def _cpu_flags() -> frozenset[str]:
    """Return the flags of the first processor in /proc/cpuinfo; an empty set if there are none."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except (OSError, ValueError):
        return frozenset()
    return frozenset(next((line.partition(":")[2].split() for line in lines if line.startswith("flags")), []))
