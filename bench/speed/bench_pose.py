"""Suite for asv: posing and dragging."""

from __future__ import annotations

from .made_input import POSES, MadeInput, make_input


def setup_cache() -> MadeInput:
    """Make the input once for all benchmarks."""
    return make_input()


class Pose:
    """One handle and a hundred, with and without a mirror plane, and a drag of one handle."""

    params = (POSES, ("float32", "float64"))
    param_names = ("work", "type")

    def setup(self, made: MadeInput, work: str, dtype: str) -> None:
        """Bind, and allocate the vertices."""
        self.call = made.poses(dtype)[work]

    def time_pose(self, made: MadeInput, work: str, dtype: str) -> None:
        """Pose once."""
        self.call()
