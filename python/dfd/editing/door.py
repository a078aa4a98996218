"""The name of the public function in front of what its parts refuse."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["door"]

# What a value says before the argument that it refuses: "Transform: `scale` …".
VALUE_PREFIX = re.compile(r"^[A-Za-z_.]+: (?=`)")


@contextmanager
def door(function: str) -> Iterator[None]:
    """Let every ValueError inside begin with `function`, which the caller knows, instead of the part that raised it."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{function}: {VALUE_PREFIX.sub('', str(error))}") from None
