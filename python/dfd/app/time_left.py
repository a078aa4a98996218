"""How long a distillation still takes, told from what it took so far and from how long its stages usually take."""

from __future__ import annotations

__all__ = ["TimeLeft"]

# Seconds of each stage of a distillation with the default settings on two cores, in their order. Only their proportions
# matter: how fast this machine is shows in the stages that it has done.
USUAL = {"read": 0.5, "load": 5.0, "simplify": 1.0, "render": 1.0, "encode": 8.0, "spread": 1.5, "fit": 4.0}


class TimeLeft:
    """Told of every step, says how many seconds there are to go."""

    def __init__(self) -> None:
        self._stage: str | None = None
        self._start = 0.0
        self._spent: dict[str, float] = {}

    def after(self, stage: str, done: int, total: int | None, now: float) -> float | None:
        """Seconds left when `done` of `total` items of `stage` are done at the time `now`; None when nothing tells."""
        if stage != self._stage:
            if self._stage is not None:
                self._spent[self._stage] = self._spent.get(self._stage, 0.0) + now - self._start
            self._stage, self._start = stage, now
        if stage not in USUAL:
            return None
        names = list(USUAL)
        later = sum(USUAL[name] for name in names[names.index(stage) + 1 :])
        known = [name for name in self._spent if name in USUAL]
        usual = sum(USUAL[name] for name in known)
        pace = sum(self._spent[name] for name in known) / usual if usual > 0 else 1.0
        here = max(USUAL[stage] * pace - (now - self._start), 0.0)
        if total and done:
            here = (now - self._start) * (total - done) / done
            # What this stage shows of the machine's pace counts as far as it has come.
            share = done / total
            pace = (1 - share) * pace + share * (now - self._start) / (USUAL[stage] * share)
        return here + later * pace
