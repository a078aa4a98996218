"""What colours a surface."""
from __future__ import annotations

from typing import Any


class Appearance:
    def update_hash(self, digest: Any) -> None: ...
