"""Change an edit: `add`, `move`, `change` and `set_default` do the work of the methods of `Deformer` with these names.

The argument `weights` also gives the session's mesh, the parts of the mesh, and the parts that handles hold.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, TypedDict, get_args

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.editing.controls import CONTROLS, controls_of, controls_on
from dfd.editing.edit import Edit, Handle, box_center
from dfd.editing.points import Place, place_on
from dfd.editing.presets import Counterparts
from dfd.editing.regions import VertexSet
from dfd.editing.weights.axis_motions import bend_vector, bendable_parts, level_with_axis, pivot_on
from dfd.editing.weights.session_weights import SessionWeights
from dfd.posing.transforms import MOTIONS, PivotAt, Transform, frame_of_normal, rotvec_of
from dfd.segmentation.follow import Follow
from dfd.weights.bind import Falloff

Pivot = ArrayLike | Literal["auto", "base", "middle", "point", "plane", "hinge"]


class MotionOptions(TypedDict, total=False):
    """The motions of a handle; `Deformer.add` explains them."""

    translation: ArrayLike | None
    rotation: Any  # also a rotation of SciPy
    scale: ArrayLike | None
    pivot: Pivot | None
    axes: ArrayLike | Literal["auto", "normal"] | None
    bend: Any
    towards: Any
    twist: float | None
    joint: float | Literal["spread", "auto", "here"] | None
    open: float | None
    matrix: ArrayLike | None


class ControlOptions(TypedDict, total=False):
    """The controls of a handle, see `dfd.editing.controls.Controls`."""

    reach: float | Literal["part"] | None
    level: int | None
    follow: Follow | None
    falloff: Falloff | None
    locality: float | None
    radius: float | str | None
    strength: float | None
    counterparts: Counterparts | None
    excluded_counterparts: Sequence[Any] | None
    detach: bool | None
    mask: Any
    mask_feather: float | str | None


class HandleOptions(MotionOptions, ControlOptions, total=False):
    """The motions and the controls of a handle."""


OF_MATRIX = ("translation", "rotation", "scale", "axes", "open")  # the motions that `matrix` determines


def add(edit: Edit, weights: SessionWeights, handle: int, at: Any, *, name: str | None, **given: Any) -> Edit:
    """Return `edit` with one more handle, whose id is `handle`.

    Without a given motion, the handle takes over the motion of the component on which it lies. So nothing moves.
    """
    matrix = _taken_matrix(given)
    check.keywords(given, (*MOTIONS, *CONTROLS), "motion or control of a handle")
    place = place_of(weights, at, given.get("level") or 0)
    motions = {name: value for name, value in given.items() if name in MOTIONS and value is not None}
    others = {name: value for name, value in given.items() if name not in MOTIONS}
    controls = controls_of(edit.preset).changed(**_controls(weights, place, others))
    new = Handle(handle, place, Transform(), controls, name)
    if matrix is None and not motions and not all(each.transform.rests for each in edit.handles):
        from dfd.editing.weights.several_handles import taken_over

        own = weights.columns_of(replace(edit, handles=(*edit.handles, new)), new)[0]
        new = replace(new, transform=taken_over(own, weights.plan(edit), edit, new, weights.mesh))
    return _moved(replace(edit, handles=(*edit.handles, new)), weights, new, motions, matrix)


def move(edit: Edit, weights: SessionWeights, handle: int, given: Mapping[str, Any]) -> Edit:
    """Return `edit` with the `given` values in the transform of a handle."""
    given = dict(given)
    matrix = _taken_matrix(given)
    check.keywords(given, MOTIONS, "motion of a handle")
    return _moved(edit, weights, edit.handle(handle), given, matrix)


def _moved(edit: Edit, weights: SessionWeights, handle: Handle, given: Mapping[str, Any], matrix: Any) -> Edit:
    """Return `edit` with the `given` motions of a handle. `matrix` (3, 4), unless it is None, moves it about its pivot.

    The pivot is chosen for the `given` motions, which contain those of `matrix`.
    """
    transform = _transform(handle.transform, weights, handle.place, given)
    transform = _on_part(edit, weights, replace(handle, transform=transform), given, handle.transform)
    if matrix is not None:
        transform = transform.with_matrix(matrix, handle.place.position)
    return edit.changed(handle, transform=transform)


def _taken_matrix(given: dict[str, Any]) -> Any:
    """Take `matrix` out of the `given` motions, and return it. Its rotation, scale and axes replace it.

    Rotations of SciPy become rotation vectors. Raises ValueError if a motion that `matrix` determines is also given.
    """
    for name in ("rotation", "bend"):
        if name in given:
            given[name] = rotvec_of(given[name])
    matrix = given.pop("matrix", None)
    if matrix is None:
        return None
    if twice := [name for name in OF_MATRIX if given.get(name) is not None]:
        raise ArgumentError("matrix", f"must not be given with `{twice[0]}`")
    made = Transform.of_matrix(matrix)
    given |= {"rotation": made.rotation, "scale": made.scale, "axes": "auto" if made.axes is None else made.axes}
    return matrix


def change(
    edit: Edit, weights: SessionWeights, handle: int, at: Any, name: str | None, controls: Mapping[str, Any]
) -> Edit:
    """Return `edit` with another place, other controls or another name for a handle."""
    held = edit.handle(handle)
    place = held.place if at is None else place_of(weights, at, controls.get("level") or 0)
    shaped = held.controls.changed(**_controls(weights, place, controls, held.controls.level))
    changed = edit.changed(held, place=place, controls=shaped, name=held.name if name is None else name)
    pivot_at = held.transform.pivot_at
    if pivot_at is None or (place, shaped) == (held.place, held.controls):
        return changed
    moved = changed.handle(handle)
    if pivot_at not in ("point", "plane") and not bendable_parts(weights, changed, moved):
        return changed  # the handle now holds no part with an axis, so its pivot does not change
    return changed.changed(moved, transform=_on_part(changed, weights, moved, {"pivot": pivot_at}, held.transform))


def set_default(edit: Edit, weights: SessionWeights, given: Mapping[str, Any]) -> Edit:
    """Return `edit` with the default transform D₀ of the `given` values; the identity is stored as None."""
    check.keywords(given, MOTIONS, "motion")
    if unknown := given.keys() - {name for name, said in MOTIONS.items() if not said.of_part}:
        raise TypeError(f"{unknown.pop()!r} needs the part that a handle holds, but the default transform has none")
    transform = Transform().changed(**given)
    transform.matrix(box_center(weights.mesh))
    return replace(edit, default=None if transform == Transform() else transform)


def part_at(weights: SessionWeights, at: Any, level: int = 0, *, follow: Follow = "all") -> VertexSet:
    """Return the vertices of the part at a place. `level` and `follow` are as in `dfd.Parts.part`."""
    vertex = weights.rows.anchor(place_on(weights.mesh, at))
    return VertexSet.of(weights.mesh, weights.parts.part(vertex, level, follow=follow).mask)


def place_of(weights: SessionWeights, at: Any, level: int = 0) -> Place:
    """Return the place for a vertex, a point, a region or a text. A text may name a part, such as "part@812".

    `level` is the level of a named part.
    """
    return place_on(weights.mesh, _part_named(weights, at, level))


def _controls(weights: SessionWeights, place: Place, given: Mapping[str, Any], level: int = 0) -> dict[str, Any]:
    """Convert the `given` controls of a handle at `place` to arguments of `Controls.changed`.

    `level` is the handle's present level.
    """
    mask = given.get("mask")
    if isinstance(mask, str):
        now = level if given.get("level") is None else given["level"]
        mask = part_at(weights, place, now) if mask == "part" else _part_named(weights, mask, 0)
    return controls_on(weights.mesh, {**given, "mask": mask})


def _part_named(weights: SessionWeights, at: Any, level: int) -> Any:
    """Return `at`. Two kinds of texts give a part: "part@812", and "piece@812" without counterparts."""
    if not isinstance(at, str):
        return at
    kind, _, where = at.partition("@")
    return (
        part_at(weights, where, level, follow="all" if kind == "part" else "none")
        if where and kind in ("part", "piece")
        else at
    )


def _transform(transform: Transform, weights: SessionWeights, place: Place, given: Mapping[str, Any]) -> Transform:
    """Return `transform` with the `given` values that need no part (`_of_part`). The axes "normal" become vectors."""
    values: dict[str, Any] = {name: value for name, value in given.items() if not _of_part(name, value)}
    axes = values.get("axes")
    if isinstance(axes, str) and axes != "auto":
        if axes != "normal":
            raise ArgumentError("axes", f"must be normal, auto or 3 unit vectors at right angles, got {axes!r}")
        normal = np.asarray(weights.mesh.normals[weights.rows.anchor(place)], np.float64)
        if not normal.any():
            raise ArgumentError("axes", "cannot be 'normal': the surface has no normal at the handle")
        values["axes"] = frame_of_normal(normal)
    return transform.changed(**values)


def _of_part(name: str, value: Any) -> bool:
    """Return whether the motion `name` with this `value` depends on the part that the handle holds."""
    if name in ("pivot", "joint"):
        return isinstance(value, str) and (name, value) not in (("pivot", "auto"), ("joint", "spread"))
    return name in ("towards", "open") or (name == "bend" and np.ndim(value) == 0)


def _on_part(
    edit: Edit, weights: SessionWeights, held: Handle, given: Mapping[str, Any], before: Transform
) -> Transform:
    """Return the transform of a handle with those `given` values that depend on the part that the handle holds.

    The default pivot is chosen if `before`, the earlier transform, has no rotation or scale, or if "auto" is given.
    """
    found: dict[str, Any] = {key: value for key, value in given.items() if value is not None and _of_part(key, value)}
    transform = held.transform
    begins = not before.turns or given.get("pivot") is not None
    auto = edit.rules.pivot == "auto" and transform.turns and transform.pivot is None and begins
    if not found and not auto:
        return transform
    pivot = found.get("pivot")
    if pivot is not None and pivot not in get_args(PivotAt):
        raise ArgumentError("pivot", f"must be auto, {', '.join(get_args(PivotAt))} or 3 numbers, got {pivot!r}")
    joint = found.get("joint")
    if joint not in (None, "auto", "here"):
        raise ArgumentError("joint", f"must be spread, auto, here or a number from 0 to 1, got {joint!r}")
    if "towards" in found and "bend" not in found:
        missing = given.get("bend") is None
        must = "given with `towards`" if missing else "one angle, and not a vector, beside `towards`"
        raise ArgumentError("bend", f"must be {must}")
    part: dict[str, Any] = {}
    if pivot in ("point", "plane"):
        part["pivot"], part["pivot_at"] = pivot_on(None, found.pop("pivot"), held, edit.symmetry)
    parts = bendable_parts(weights, edit, held) if found or not part else []
    if not parts:
        if not found:
            return transform.changed(**part)
        level = level_with_axis(weights, edit, held)
        instead = "" if level is None else f"; the part at level {level} has one"
        raise ArgumentError(next(iter(found)), f"needs a part with an axis, and the handle holds none{instead}")
    own = parts[0]
    if "open" in found:
        middle, across = own.axis.hinge
        part = {"rotation": check.number(None, "open", found["open"]) * across, "pivot": middle, "pivot_at": "hinge"}
    elif not part and (pivot is not None or auto):
        part["pivot"], part["pivot_at"] = pivot_on(own, pivot, held, edit.symmetry)
    if "bend" in found:
        part["bend"] = bend_vector(own, found["bend"], found.get("towards"))
    if joint is not None:
        find = own.axis.joint if joint == "auto" else own.axis.nearest
        part["joint"] = find(np.asarray(held.place.position))
    return transform.changed(**part)
