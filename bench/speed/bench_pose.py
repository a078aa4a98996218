"""Benchmarks for asv: pose a shape, and drag one handle."""

from .made_input import MOTIONS, MadeInput, make_input


def setup_cache() -> MadeInput:
    """Make the input once for all benchmarks."""
    return make_input()


class Pose:
    """Pose with 1 and 100 handles: without and with a mirror plane, and in a drag that moves one handle."""

    params = (MOTIONS, (1, 100), ("float32", "float64"))
    param_names = ("motion", "handles", "type")

    def setup(self, made: MadeInput, motion: str, handles: int, dtype: str) -> None:
        """Bind, and allocate the moved vertices."""
        self.call = made.pose(motion, handles, dtype)

    def time_pose(self, made: MadeInput, motion: str, handles: int, dtype: str) -> None:
        """Pose once."""
        self.call()
