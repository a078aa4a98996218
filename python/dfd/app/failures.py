"""What people are told when something does not work."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from pathlib import Path

__all__ = ["NO_MEMORY", "sentence", "without_places"]

log = logging.getLogger("dfd.app")

# What the package's own messages begin with, for those who call its functions.
_FUNCTION = re.compile(r"^\w+(\.\w+)?: ")

NO_MEMORY = "Memory ran out; nothing was changed. Take a smaller mesh, or close other programs"


def sentence(error: Exception) -> str:
    """Why a request was not done; what is no fault of the person's goes to the log as well."""
    if isinstance(error, MemoryError) or "can't allocate memory" in str(error):  # as torch says it
        return NO_MEMORY
    if isinstance(error, (ValueError, OSError)):
        return str(error)
    log.error("a request failed", exc_info=error)
    return f"That did not work, for a fault of this program: {type(error).__name__}: {error}"


def without_places(why: str, names: Mapping[str, str], folder: Path) -> str:
    """`why` without the session's `folder`, and with files by the `names` that people know them by."""
    for path, name in names.items():
        why = why.replace(f"`path` {path}", name).replace(path, name)
    return _FUNCTION.sub("", why.replace(f"{folder}/", ""))
