"""Name the steps of undo and redo, and go to one of them."""

from dataclasses import fields
from itertools import pairwise

from dfd.app.session.marks import marks_in
from dfd.common.described import about
from dfd.editing.controls import Controls
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit, Handle

MOST_LISTED = 50  # largest number of listed steps before and after the present state
MOTIONS = {"translation": "Move", "rotation": "Rotate", "scale": "Scale", "bend": "Bend", "twist": "Twist"}


class Steps:
    """The steps of an editing session since the newest call of `begin`."""

    def __init__(self, deformer: Deformer) -> None:
        self._deformer = deformer
        self.begin()

    def begin(self) -> None:
        """Make the present edit the first one that undo can reach."""
        self._first = self._deformer.edit

    def _window(self) -> tuple[int, int, int]:
        """Return the indices of the first listed state, the present state, and the end of the listed states."""
        states, now = self._deformer.states
        first = next((i for i, state in enumerate(states[: now + 1]) if state is self._first), 0)
        return max(first, now - MOST_LISTED), now, min(len(states), now + MOST_LISTED + 1)

    @property
    def done(self) -> int:
        """Return the number of listed steps that are done."""
        first, now, _ = self._window()
        return now - first

    def names(self) -> tuple[str, ...]:
        """Return the names of the listed steps, the oldest first."""
        first, _, end = self._window()
        return tuple(named(before, after) for before, after in pairwise(self._deformer.states[0][first:end]))

    def go(self, by: int) -> None:
        """Redo the next `by` listed steps; undo if `by` is negative. Stop if no step is left."""
        first, now, end = self._window()
        for _ in range(min(by, end - 1 - now) if by > 0 else min(-by, now - first)):
            self._deformer.redo() if by > 0 else self._deformer.undo()


def named(before: Edit, after: Edit) -> str:
    """Return the name of a step between two edits."""
    was, now = ({handle.id: handle for handle in edit.handles} for edit in (before, after))
    for verb, one, other in (("Add", now, was), ("Remove", was, now)):
        if new := [handle for key, handle in one.items() if key not in other]:
            return f"{verb} {_called(new)}"
    if changed := [key for key in was if was[key] != now[key]]:
        what = _change(was[changed[0]], now[changed[0]])
        return f"{what} {_called([now[key] for key in changed])}"
    if before.fixed != after.fixed:
        more = len(after.fixed) - len(before.fixed)
        return "Fix a place" if more > 0 else "Release a place" if more < 0 else "Change a fixed place"
    if before.poses != after.poses:
        return "Change the key poses"
    if before.default != after.default:
        return "Move the rest of the shape"
    if marks_in(before) != marks_in(after):
        return "Change the marks"
    return "Change the preset" if before.preset != after.preset else "Change the symmetry"


def _called(handles: list[Handle]) -> str:
    first = handles[0]
    return f"{len(handles)} handles" if len(handles) > 1 else first.name or f"handle {first.id}"


def _change(before: Handle, after: Handle) -> str:
    """Return what changed, as the words before the name of the handle."""
    if before.transform != after.transform:
        if after.transform.rests and not before.transform.rests:
            return "Return to rest:"
        motions = (verb for name, verb in MOTIONS.items() if _differ(before.transform, after.transform, name))
        return next(motions, "Change the pivot of")
    if before.place != after.place or before.controls.level != after.controls.level:
        return "Change the part of"
    described = about(Controls)
    for each in fields(Controls):
        said = described[each.name][1] if each.name in described else None
        if said is not None and _differ(before.controls, after.controls, each.name):
            return f"Change {said.called(each.name).lower()} of"
    return "Rename"


def _differ(before: object, after: object, name: str) -> bool:
    return bool(getattr(before, name) != getattr(after, name))
