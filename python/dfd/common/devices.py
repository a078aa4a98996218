"""Where torch computes, and what it says when there is no room left."""

from __future__ import annotations

import torch

__all__ = ["choose_device", "out_of_memory"]


def choose_device(function: str, device: str | torch.device | None) -> torch.device:
    """Return `device` as torch names it; None takes a CUDA device when there is one.

    Raises
    ------
    ValueError
        In the name of `function`, if torch cannot use it.
    """
    if device is None:
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        target = torch.device(device)
        torch.empty(0, device=target)
    except (RuntimeError, AssertionError, TypeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise ValueError(f"{function}: `device` must be one that torch can use, got {device!r}: {reason}") from None
    return target


def out_of_memory(error: BaseException) -> bool:
    """Whether `error` says that memory was refused: Python, NumPy and torch each have their own way."""
    return isinstance(error, MemoryError | torch.cuda.OutOfMemoryError) or (
        isinstance(error, RuntimeError) and "can't allocate memory" in str(error)
    )
