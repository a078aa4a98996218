"""Other controls that a handle could have: who follows, and how large its part is."""

from collections.abc import Iterator
from typing import Any

from dfd.app.session.parts import ShapeParts
from dfd.editing.controls import CONTROLS
from dfd.editing.deformer import Deformer
from dfd.editing.presets import PRESETS

FOLLOWERS = {"none": "Only this", "mirror": "Mirrored", "all": "All alike"}


def proposals(deformer: Deformer, parts: ShapeParts, handle: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the label and the controls of each proposal for a handle with the reach "part".

    If there is the control `follow`, its other two values are proposed; otherwise, counterparts are switched on or off.
    """
    own = deformer.edit.handle(handle)
    if own.controls.reach != "part" or own.place.region is not None:
        return
    if "follow" in CONTROLS:
        for value, label in FOLLOWERS.items():
            if value != getattr(own.controls, "follow", None):
                yield label, {"follow": value}
    elif own.controls.counterparts == "only":
        yield FOLLOWERS["all"], {"counterparts": str(PRESETS[deformer.preset].handle["counterparts"])}
    else:
        yield FOLLOWERS["none"], {"counterparts": "only"}
    for step, label in ((-1, "Smaller"), (1, "Larger")):
        try:
            level = parts.next_level(parts.origin(own), own.controls.level, step)
        except ValueError:
            continue
        yield label, {"level": level}
