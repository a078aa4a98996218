"""Undo and redo without limit: all states of an edit are kept. Unchanged values are shared, so a state is small."""

from collections.abc import Hashable, Iterator
from contextlib import contextmanager

from dfd.editing.edit import Edit


class History:
    """All states of an edit, and the index of the present one."""

    __slots__ = ("_floor", "_now", "_states", "_topic")

    def __init__(self, start: Edit) -> None:
        self._states: tuple[Edit, ...] = (start,)  # a tuple, so that `copy.copy` gives an independent history
        self._now = 0
        self._floor = 0  # index of the oldest state that `undo` can reach: 0, or the first state of a `step` block
        self._topic: Hashable = None  # what the newest step changed, such as ("handle", 1); None if no step may join it

    @property
    def edit(self) -> Edit:
        """Return the present state, an immutable value."""
        return self._states[self._now]

    def _record(self, state: Edit, topic: Hashable = None, merge: bool = False) -> None:
        """Make `state` the present state, and discard undone steps. A state that equals the present one adds no step.

        With `merge`, `state` replaces the result of the newest step if that step has the same `topic`.
        """
        joins = merge and topic is not None and topic == self._topic
        if state != self.edit:
            self._now += 0 if joins else 1
            self._states = (*self._states[: self._now], state)
            self._topic = topic
        elif not joins:
            self._topic = None

    @property
    def states(self) -> tuple[tuple[Edit, ...], int]:
        """Return all states, the oldest first, and the index of the present state."""
        return self._states, self._now

    @property
    def can_undo(self) -> bool:
        """Return whether there is a step to take back."""
        return self._now > self._floor

    @property
    def can_redo(self) -> bool:
        """Return whether there is a step that was taken back."""
        return self._now + 1 < len(self._states)

    def undo(self) -> bool:
        """Take back the newest step; return False if there is none."""
        return self._go(-1) if self.can_undo else False

    def redo(self) -> bool:
        """Repeat the step that was taken back last; return False if there is none."""
        return self._go(+1) if self.can_redo else False

    def _go(self, steps: int) -> bool:
        self._now += steps
        self._topic = None
        return True

    @contextmanager
    def step(self, topic: Hashable = None, *, merge: bool = False) -> Iterator[None]:
        """Record all changes in the block `with deformer.step():` as one step. If the block raises, undo them all.

        With `merge`, this step joins the previous step if both have the same `topic`, which must not be None.
        """
        start, floor, before, about = self._now, self._floor, self._states, self._topic
        self._floor, self._topic = start, None
        try:
            yield
        except BaseException:
            self._states, self._now = before, start
            raise
        finally:
            self._floor, self._topic = floor, about
        made = self.edit
        if self._now > start:
            self._states, self._now = self._states[: start + 1], start
        self._record(made, topic, merge)
