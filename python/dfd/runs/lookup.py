"""Fields that were made before, by the recipe of the call that would make them again."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dfd.runs import field_cache
from dfd.runs.checkpoint import Checkpoint

# torch is not needed for what the cache has.
if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.runs.field_cache import CachedField, Found

__all__ = ["find_field", "find_field_file"]


def find_field(recipe: Mapping[str, Any], checkpoint: str | os.PathLike[str] | None = None) -> Field | None:
    """Return the field that the user's cache has for `recipe`, or None.

    What an earlier run of the same recipe left undone in the folder `checkpoint` is of no use then, and goes.
    """
    return _without_checkpoint(field_cache.find(recipe), recipe, checkpoint)


def find_field_file(recipe: Mapping[str, Any], checkpoint: str | os.PathLike[str] | None = None) -> CachedField | None:
    """As `find_field`, for the file alone, which takes no torch."""
    return _without_checkpoint(field_cache.find_file(recipe), recipe, checkpoint)


def _without_checkpoint(
    found: Found | None, recipe: Mapping[str, Any], checkpoint: str | os.PathLike[str] | None
) -> Found | None:
    if found is not None and checkpoint is not None:
        Checkpoint.discard(checkpoint, recipe)
    return found
