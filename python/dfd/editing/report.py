"""x"""

from __future__ import annotations

from typing import Any

Report = Any


def report(*a: Any) -> Any:
    return None
