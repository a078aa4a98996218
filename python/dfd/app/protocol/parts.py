"""What messages are made of."""

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
# How a handle takes another part: the next size, with another part, or what the file makes one thing.
PartChange = Literal["smaller", "larger", "add", "remove", "scene_part", "material", "component"]


class Model(BaseModel):
    """Checked to the letter: no unknown key, no text for a number, no number that is not finite."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Region(Model):
    """A set of vertices as one: `mask` is a bit per vertex, lowest bit first, in bytes written as base64."""

    mask: Annotated[str, Field(min_length=4, pattern=r"^[A-Za-z0-9+/]+={0,2}$")]


Place = Index | Region  # a vertex, or several as one


class Transform(Model):
    """Scale along `axes`, then rotation, then translation, about the pivot.

    Null leaves a part as it is. `rotation` is a rotation vector in degrees; `axes` are one a row, "auto" for the mesh's
    own, and "normal" for a frame whose third axis is the surface's normal at the handle. A pivot of "auto" is found
    once the handle turns or scales. `bend`, a rotation vector or an upward angle, and `twist`, in degrees, come first,
    along the axis of the part that is held, at the `joint` or all along it.
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
    """What a handle holds and how; null leaves it as it is."""

    name: Text | None = None


class ControlEntry(Model):
    """How a panel shows a control of a handle, or of all of them: as a slider, a choice or a switch."""

    name: str
    label: str
    hint: str
    kind: Literal["number", "length", "choice", "switch"]
    choices: tuple[str, ...]  # the words that stand for a value; of a number, besides numbers
    slider: Vector | None  # its ends and its step; of a length, parts of the shape's size


# Controls that are another type in messages than in an edit: in requests, and in the state.
GIVEN: dict[str, Any] = {
    "radius": float | str,
    "mask": Region | Literal["everywhere", "part"],
    "excluded_counterparts": Annotated[tuple[Index, ...], Field(max_length=1000)],  # vertices
}
SHOWN: dict[str, Any] = {
    "reach": float,  # what "part" found, if that is asked for
    "mask": int,  # how many vertices the region has beyond which nothing follows; 0 is everywhere
    "excluded_counterparts": tuple[int, ...],  # vertices on those that are switched off
}


def control_types(types: dict[str, Any]) -> dict[str, Any]:
    """The type of each control: those of an edit, but for `types`."""
    return {**{name: kind for name, (kind, _) in about(editing.Controls).items()}, **types}


def control_entries() -> tuple[ControlEntry, ...]:
    """How panels show the controls, in order; what takes places and regions has a panel of its own."""
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
    """The transform of a handle; everything as in `Transform`, and nothing left out."""

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
