"""GNU's OpenMP runtime, which the kernels are linked against and torch brings a copy of: one serves both."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from contextlib import suppress
from pathlib import Path

NAME = "libgomp.so.1"


def load_runtime() -> None:
    """Load the runtime, torch's copy where torch is installed unless some copy is loaded already, and then the kernels.

    The kernels, and torch when it is imported later, then find the runtime loaded under its name and load no other. The
    copy of torch comes before the system's: it serves torch and the kernels, it is there where the system has none, and
    the system's may be older than what torch was built for. A torch that names its copy by a hash keeps it to itself:
    the kernels then need the system's.

    Raises ImportError if the kernels need the runtime and neither torch nor the system has it.
    """
    if sys.platform.startswith("linux") and not _is_loaded() and (found := find_torch_runtime()) is not None:
        with suppress(OSError):  # a damaged copy: the kernels ask the system for theirs
            ctypes.CDLL(str(found))
    try:
        importlib.import_module("dfd._core")
    except ImportError as error:
        if NAME not in str(error):
            raise
        reason = f"dfd needs GNU's OpenMP runtime, {NAME}, and neither torch nor the system has it under that name"
        raise ImportError(f"{reason}: install libgomp1 (Debian, Ubuntu) or libgomp (Fedora)") from error


def find_torch_runtime() -> Path | None:
    """Where torch keeps `libgomp.so.1`, without importing torch; None where it is not installed or keeps none."""
    spec = importlib.util.find_spec("torch")
    for folder in (spec.submodule_search_locations or []) if spec is not None else []:
        package = Path(folder)
        for path in (package / "lib" / NAME, package.parent / "torch.libs" / NAME):
            if path.is_file():
                return path
    return None


def _is_loaded() -> bool:
    try:
        ctypes.CDLL(NAME, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
    except OSError:
        return False
    return True
