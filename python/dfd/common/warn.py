"""Warnings that point at the caller's own line, however deep in the package they arise."""

from __future__ import annotations

import sys
import warnings

__all__ = ["warn"]

_PASSED_OVER = ("dfd", "contextlib", "concurrent", "threading")


def warn(message: str, category: type[Warning]) -> None:
    """Give a warning in the name of whoever called the package."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _PASSED_OVER:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
