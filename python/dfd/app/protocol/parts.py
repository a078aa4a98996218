"""Types of the fields of messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, create_model

import dfd.editing.controls as editing
from dfd.common.described import about, words_of
from dfd.editing.edit import Edit
from dfd.posing.transforms import PivotAt

Vector = tuple[float, float, float]
Frame = tuple[Vector, Vector, Vector]
Index = Annotated[int, Field(ge=0)]
Text = Annotated[str, Field(min_length=1, max_length=1000)]
# How a handle changes its part: to the next size, with another part added or removed, or to a unit of the file.
PartChange = Literal["smaller", "larger", "add", "remove", "scene_part", "material", "component"]


class Model(BaseModel):
    """The base of all messages, with strict checks: unknown keys, wrong types and numbers not finite are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Region(Model):
    """A set of vertices: `mask` has a bit per vertex, lowest bit first, in bytes encoded as base64."""

    mask: Annotated[str, Field(min_length=4, pattern=r"^[A-Za-z0-9+/]+={0,2}$")]


Place = Index | Region  # a vertex or a region


class Transform(Model):
    """Scale along `axes`, then rotation, then translation, about the pivot.

    Null keeps a value. `rotation` is a rotation vector in degrees. `axes` has one axis per row; "auto" is the mesh's
    axes, and "normal" a frame whose third axis is the surface's normal at the handle. A pivot of "auto" is found when
    the handle turns or scales. `bend` (a rotation vector or an upward angle) and `twist`, in degrees, are applied
    first, along the axis of the held part, at the `joint` or over the whole length.
    """

    translation: Vector | None = None
    rotation: Vector | None = None
    scale: Vector | None = None
    pivot: Vector | PivotAt | Literal["auto"] | None = None
    axes: Frame | Literal["normal", "auto"] | None = None
    bend: Vector | float | None = None
    twist: float | None = None
    joint: Annotated[float, Field(ge=0, le=1)] | Literal["spread", "auto", "here"] | None = None


class NamedControls(Model):
    """Controls and name of a handle; null keeps a value."""

    name: Text | None = None


class ControlEntry(Model):
    """How a panel shows a control: as a slider, a choice or a switch."""

    name: str
    label: str
    hint: str
    kind: Literal["number", "length", "choice", "switch"]
    choices: tuple[str, ...]  # words that are allowed as values
    slider: Vector | None  # both ends and the step; for a length, as fractions of the shape's size


# Controls whose type in messages differs from that in an edit: in requests (GIVEN), and in the state (SHOWN).
GIVEN: dict[str, Any] = {
    "radius": float | str,
    "mask": Region | Literal["everywhere", "part"],
    "excluded_counterparts": Annotated[tuple[Index, ...], Field(max_length=1000)],  # vertices
}
SHOWN: dict[str, Any] = {
    "reach": float,  # the resulting number for "part"
    "mask": int,  # number of vertices of the mask; 0 without a mask
    "excluded_counterparts": tuple[int, ...],  # a vertex on each excluded counterpart
}


def control_types(types: dict[str, Any]) -> dict[str, Any]:
    """Return the type of each control: that of an edit, or that in `types`."""
    return {**{name: kind for name, (kind, _) in about(editing.Controls).items()}, **types}


def control_entries() -> tuple[ControlEntry, ...]:
    """Return the entries of all controls in order, except those with places and regions."""
    entries = []
    for name, (kind, said) in {**about(editing.Controls), "preset": about(Edit)["preset"]}.items():
        if said is None or said.repeated or name == "mask":
            continue
        kinds = (kind, *get_args(kind))
        is_length = said.metavar is not None and "%" in said.metavar
        shown: Any = "length" if is_length else "number" if float in kinds else "switch" if bool in kinds else "choice"
        label, choices = said.called(name), words_of(kind)
        entries.append(
            ControlEntry(name=name, label=label, hint=said.text, kind=shown, choices=choices, slider=said.slider)
        )
    return tuple(entries)


if TYPE_CHECKING:
    Controls = NamedControls
else:
    Controls = create_model(
        "Controls",
        __base__=NamedControls,
        __doc__=NamedControls.__doc__,
        **{name: (kind | None, None) for name, kind in control_types(GIVEN).items()},
    )


class PoseTransform(Model):
    """The complete transform of a handle, with fields as in `Transform`."""

    handle: Index
    translation: Vector
    rotation: Vector
    scale: Vector
    pivot: Vector | None = None
    axes: Frame | None = None
    bend: Vector = (0.0, 0.0, 0.0)
    twist: float = 0.0
    joint: float | None = None


PoseTransforms = Annotated[tuple[PoseTransform, ...], Field(max_length=1000)]


class KeyPose(Model):
    """A stored pose on the timeline."""

    name: Text
    seconds: Annotated[float, Field(ge=0)]
    transforms: PoseTransforms


KeyPoses = Annotated[tuple[KeyPose, ...], Field(max_length=1000)]
