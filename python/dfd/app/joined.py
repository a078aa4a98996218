"""Two steps of an editing session made one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["joined"]

Result = TypeVar("Result")


def joined(deformer: Deformer, work: Callable[[Deformer], Result]) -> Result:
    """Do `work` as one step with the newest one; where it fails, that one stays as it is."""
    newest = deformer.edit
    deformer.undo()
    try:
        with deformer.step():
            deformer.apply(newest)
            return work(deformer)
    except BaseException:
        deformer.redo()
        raise
