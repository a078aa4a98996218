"""Check everything about an edit that needs no field, before `dfd distill` takes its time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.cli.arguments import OF_THE_FIELD, find_place, fixed_place
from dfd.common import check
from dfd.common.preset import Preset
from dfd.posing.transforms import MOTIONS, Transform

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh


class _NeedsFieldError(Exception):
    """What comes next needs the features of a field."""


class _MeshOnly:
    """Stand for the weights of a session that has no field."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh

    def __getattr__(self, name: str) -> Any:
        raise _NeedsFieldError(name)


def check_edit(
    mesh: Mesh,
    handles: Sequence[tuple[str, dict[str, Any]]],
    fix: Sequence[str] | None,
    *,
    edit: Path | None = None,
    preset: Preset | None = None,
    other_shape: bool = False,
) -> None:
    """Raise ValueError if a place, a motion or a control is wrong on `mesh`, or two places are one.

    `handles` are pairs of a place and arguments of `Deformer.add`. `edit` is a file that already has some handles.
    Places and masks that name a part of the field are not checked.
    """
    from dfd.editing import verbs
    from dfd.editing.edit import Edit, Fixed
    from dfd.editing.edit_file import read_edit
    from dfd.editing.weights.axis_motions import TOWARDS

    weights: Any = _MeshOnly(mesh)
    held = Edit(preset=preset or "default")
    for number, (text, given) in enumerate(handles, 1):
        named, mask = OF_THE_FIELD.match(text), given.get("mask")
        at = 0 if named else find_place("--handle", text, mesh, quiet=True)
        unknown = isinstance(mask, str) and (mask == "part" or OF_THE_FIELD.match(mask))
        given = {"name": None, **given, "mask": None if unknown else mask}
        for name in ("bend", "open"):  # the session checks these two after it has found the part
            if isinstance(given.get(name), str):
                check.number(None, name, given[name])
        if isinstance(given.get("towards"), str):
            check.choice(None, "towards", given["towards"], tuple(TOWARDS))
        try:
            added = verbs.add(held, weights, number, at, **given)
        except _NeedsFieldError:
            unmoved = {name: value for name, value in given.items() if name not in MOTIONS}
            added = verbs.add(held, weights, number, at, **unmoved)
        if not named:  # at rest, so that the next handle does not take over a motion
            held = replace(added, handles=tuple(replace(each, transform=Transform()) for each in added.handles))
    still = [fixed_place(text) for text in fix or () if not OF_THE_FIELD.match(text)]
    fixed = [Fixed(find_place("--fix", text, mesh, quiet=True), strength) for text, strength in still]
    Edit(held.handles, tuple(fixed))
    if edit is not None:
        read_edit(edit, mesh, other_shape=other_shape)


def check_plane(mesh: Mesh, plane: str, **how: Any) -> None:
    """Raise ValueError if the text `plane`, or an argument of `Deformer.set_symmetry` in `how`, is wrong on `mesh`."""
    from dfd.editing.edit import symmetry_on
    from dfd.editing.presets import SymmetryCandidates

    if plane != "auto":
        symmetry_on(mesh, plane, **how)
        return
    if how["band"] is not None:
        check.number(None, "band", how["band"], minimum=0.0)
    if how["candidates"] is not None:
        check.choice(None, "symmetry_candidates", how["candidates"], SymmetryCandidates)
    if how["threshold"] not in (None, "relative"):
        check.number(None, "symmetry_threshold", how["threshold"], minimum=0.0, exclusive=True)
