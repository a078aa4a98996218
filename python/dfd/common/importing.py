"""What stands around the import of large libraries."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

from dfd.common.interrupts import heed_interrupts

__all__ = ["importing"]


@contextmanager
def importing() -> Iterator[None]:
    """Importing makes a million objects that stay: searching them for garbage, over and over, takes a tenth of it.

    The one search that comes at the end belongs to it, for an interruption that meets a finalizer there would be lost.
    """
    with heed_interrupts():
        enabled = gc.isenabled()
        gc.disable()
        try:
            yield
        finally:
            if enabled:
                gc.enable()
                gc.collect(0)
