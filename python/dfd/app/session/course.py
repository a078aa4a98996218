"""The stages between opening a file and the first handle: their names for users, and the time left."""

import math
import time

# The stages in order: the name for users, the usual seconds with default settings on two CPU cores, and the further
# seconds for each million faces.
STAGES: dict[str, tuple[str, float, float]] = {
    "wait": ("Waiting for another shape", 0.0, 0.0),
    "read": ("Reading the file", 0.5, 4.0),
    "send": ("Drawing the shape", 0.5, 8.0),
    "load": ("Starting to learn", 5.0, 0.0),
    "up": ("Finding which way is up", 3.0, 3.0),
    "simplify": ("Simplifying the shape", 0.5, 3.0),
    "render": ("Taking pictures of the shape", 1.0, 2.0),
    "encode": ("Looking at the pictures", 8.0, 0.0),
    "smooth": ("Combining the pictures", 1.5, 0.0),
    "fit": ("Learning what looks alike", 4.0, 0.0),
    "features": ("Comparing the surface", 0.5, 8.0),
    "parts": ("Finding parts", 1.0, 12.0),
}
OTHERS = {"cut": "Finding places for handles"}  # stages of other tasks, and their names for users
ENDS = {"done": "Done", "cancelled": "Cancelled", "failed": "Failed"}  # last stages, and their names for users
LEARNED = ("features", "parts")  # the stages of a shape whose field is known
PACE = 1.5  # expected duration, divided by the usual one, before anything was measured
TRUST = 4.0  # usual seconds of work after which a measured pace counts as much as `PACE`
KNOWN = 1.25  # if the latest estimate is above the shown one by more than this factor, the time left is not known


class Course:
    """The progress through `stages` for a mesh of `faces` faces. The time left never grows.

    It is not known before `TRUST` seconds of usual work, nor while the work is slower than it was.
    """

    def __init__(self, faces: int, stages: tuple[str, ...] = tuple(STAGES)) -> None:
        self._usual = {name: STAGES[name][1] + STAGES[name][2] * faces / 1e6 for name in STAGES if name in stages}
        self._begun = self._since = time.monotonic()
        self._stage = ""
        self._left = math.inf

    def at(self, stage: str, done: int, total: int | None) -> tuple[float, float | None]:
        """Return the share of the time that has passed, and the seconds left, after `done` of `total` items.

        The seconds are None if they are not known.
        """
        now, usual = time.monotonic(), self._usual
        if stage != self._stage:
            self._stage, self._since = stage, now
        names = list(usual)
        spent = sum(usual[name] for name in names[: names.index(stage)])
        # Without a number of items, the stage approaches its end, but does not reach it.
        part = done / total if total else -math.expm1((self._since - now) / max(PACE * usual[stage], 1.0))
        spent += usual[stage] * min(part, 1.0)
        elapsed = now - self._begun
        pace = (PACE * TRUST + elapsed) / (TRUST + spent)
        left = pace * (sum(usual.values()) - spent)
        self._left = min(self._left, left)
        known = spent >= TRUST and left <= KNOWN * self._left
        return elapsed / max(elapsed + self._left, 1e-9), self._left if known else None
