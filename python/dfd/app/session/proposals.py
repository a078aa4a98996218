"""Other controls that a handle could have: who follows, and how large its part is."""

from collections.abc import Iterator
from typing import Any

from dfd.app.session.parts import ShapeParts
from dfd.editing.deformer import Deformer

FOLLOWERS = {"none": "Only this", "mirror": "Mirrored", "all": "All alike"}


def proposals(deformer: Deformer, parts: ShapeParts, handle: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the label and the controls of each proposal for a handle with the reach "part".

    The two other choices of who follows are proposed, and the next smaller and the next larger part.
    """
    own = deformer.edit.handle(handle)
    if own.controls.reach != "part" or own.place.region is not None:
        return
    for value, label in FOLLOWERS.items():
        if value != own.controls.follow:
            yield label, {"follow": value}
    for step, label in ((-1, "Smaller"), (1, "Larger")):
        try:
            level = parts.next_level(parts.origin(own), own.controls.level, step)
        except ValueError:
            continue
        yield label, {"level": level}
