"""Check everything about an edit that needs no field, before `dfd distill` takes its time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from dfd.cli.arguments import OF_THE_FIELD, find_place, fixed_place
from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.preset import Preset
from dfd.editing.controls import CONTROLS
from dfd.posing.transforms import MOTIONS

if TYPE_CHECKING:
    from dfd.editing.controls import Controls
    from dfd.editing.points import Place
    from dfd.mesh.mesh import Mesh


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
    from dfd.editing.edit import Edit, Fixed, Handle
    from dfd.editing.edit_file import read_edit

    held: list[Handle] = []
    for number, (text, given) in enumerate(handles, 1):
        _check_motions(given)
        controls = _controls(mesh, given, preset)
        if not OF_THE_FIELD.match(text):
            held.append(Handle(number, find_place("--handle", text, mesh, quiet=True), controls=controls))
    still = [fixed_place(text) for text in fix or ()]
    places = [(_fixed(mesh, text), strength) for text, strength in still if not OF_THE_FIELD.match(text)]
    Edit(tuple(held), tuple(Fixed(place, strength) for place, strength in places))
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


def _fixed(mesh: Mesh, text: str) -> Place:
    return find_place("--fix", text, mesh, quiet=True)


def _check_motions(given: dict[str, Any]) -> None:
    """Check the motions of a handle, apart from their effect on the part that the handle holds."""
    from dfd.editing.weights.axis_motions import TOWARDS
    from dfd.posing.transforms import PivotAt, Transform, vector

    motions = {name: value for name, value in given.items() if name in MOTIONS}
    words = {"pivot": ("auto", *get_args(PivotAt)), "joint": ("spread", "auto", "here"), "axes": ("normal", "auto")}
    for name, known in words.items():
        if isinstance(value := motions.get(name), str):
            check.choice(None, name, value, known)
            del motions[name]
    for name in ("bend", "open", "twist"):
        if name in motions:
            check.number(None, name, motions.pop(name))
    towards = motions.pop("towards", None)
    if isinstance(towards, str):
        check.choice(None, "towards", towards, tuple(TOWARDS))
    elif towards is not None:
        vector("towards", towards)
    if towards is not None and "bend" not in given:
        raise ArgumentError("bend", "must be given with `towards`")
    Transform().changed(**motions)


def _controls(mesh: Mesh, given: dict[str, Any], preset: Preset | None) -> Controls:
    """Return the controls of a handle, without a mask that names a part."""
    from dfd.editing.controls import controls_of, controls_on

    controls = {name: value for name, value in given.items() if name in CONTROLS}
    mask = controls.get("mask")
    if isinstance(mask, str) and (mask == "part" or OF_THE_FIELD.match(mask)):
        del controls["mask"]
    return controls_of(preset or "default").changed(**controls_on(mesh, controls))
