"""Fields that were made before, by the recipe of the call that would make them again."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from dfd.field.field import Field
from dfd.runs import field_cache
from dfd.runs.checkpoint import Checkpoint

__all__ = ["find_field"]


def find_field(recipe: Mapping[str, Any], checkpoint: str | os.PathLike[str] | None = None) -> Field | None:
    """Return the field that the user's cache has for `recipe`, or None.

    What an earlier run of the same recipe left undone in the folder `checkpoint` is of no use then, and goes.
    """
    found = field_cache.find(recipe)
    if found is not None and checkpoint is not None:
        Checkpoint.discard(checkpoint, recipe)
    return found
