"""Suite for asv: what a person waits for in a session on a fine mesh."""

from __future__ import annotations

import os

os.environ.setdefault("HF_HUB_OFFLINE", "1")  # the network that is installed is measured, not what a hub answers

from .session import SIZES, STEPS, Row, field, measured


class Session:
    """One session for each size: seconds of each step, and GB of memory."""

    params = (SIZES, STEPS)
    param_names = ("vertices", "step")
    timeout = 600

    def setup_cache(self) -> dict[int, Row]:
        """Measure each size once."""
        of_shape = field()
        return {count: measured(count, of_shape) for count in SIZES}

    def track_session(self, found: dict[int, Row], vertices: int, step: str) -> float:
        """Return what the step took."""
        return found[vertices][step]
