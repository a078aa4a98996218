"""Load one GNU OpenMP runtime for both the C++ kernels, which link against it, and torch, which contains a copy."""

import ctypes
import importlib.util
import os
import sys
from contextlib import suppress
from pathlib import Path

NAME = "libgomp.so.1"


def load_runtime() -> None:
    """Load torch's copy of the runtime, if torch is installed and no runtime is loaded; then load the C++ kernels.

    The kernels, and torch when it is imported later, find the loaded runtime by its name and use it. torch's
    copy takes precedence, because the system may have no runtime, or one that is too old for torch. Some torch packages
    add a hash to the name of their copy. The kernels cannot find such a copy, and load the system's runtime.

    Raises ImportError if the kernels need the runtime and neither torch nor the system has it.
    """
    if sys.platform.startswith("linux") and not _is_loaded() and (found := find_torch_runtime()) is not None:
        with suppress(OSError):  # if torch's copy is damaged, the kernels load the system's runtime
            ctypes.CDLL(str(found))
    try:
        importlib.import_module("dfd._core")
    except ImportError as error:
        if NAME not in str(error):
            raise
        reason = f"dfd needs GNU's OpenMP runtime, {NAME}, and neither torch nor the system has it under that name"
        raise ImportError(f"{reason}: install libgomp1 (Debian, Ubuntu) or libgomp (Fedora)") from error


def use_one_thread() -> None:
    """Limit the parallel loops of the calling thread to this thread, also those of a torch that is imported later."""
    os.environ["OMP_NUM_THREADS"] = "1"  # torch reads this when it is imported
    if _is_loaded():
        ctypes.CDLL(NAME).omp_set_num_threads(1)


def find_torch_runtime() -> Path | None:
    """Return the path of torch's `libgomp.so.1` without importing torch; None if torch or the file is missing."""
    spec = importlib.util.find_spec("torch")
    for folder in (spec.submodule_search_locations or []) if spec is not None else []:
        package = Path(folder)
        for path in (package / "lib" / NAME, package.parent / "torch.libs" / NAME):
            if path.is_file():
                return path
    return None


def _is_loaded() -> bool:
    if not hasattr(os, "RTLD_NOLOAD"):
        return False
    try:
        ctypes.CDLL(NAME, mode=os.RTLD_NOLOAD | os.RTLD_LAZY)
    except OSError:
        return False
    return True
