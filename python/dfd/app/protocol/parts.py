"""What messages are made of."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

__all__ = [
    "MOST_HANDLES",
    "Controls",
    "Frame",
    "Identifier",
    "Index",
    "KeyPose",
    "Mode",
    "Model",
    "Number",
    "Place",
    "Plane",
    "PointPlace",
    "PoseTransform",
    "RegionPlace",
    "Text",
    "Transform",
    "Vector",
    "VertexPlace",
]

MOST_INSTANCES = 1000  # that one list switches off
MOST_HANDLES = 1000  # that one edit, pose or list names
LONGEST_TEXT = 1000

Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]  # x, y, z, w
Frame = tuple[Vector, Vector, Vector]
Index = Annotated[int, Field(ge=0)]
Identifier = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Text = Annotated[str, Field(min_length=1, max_length=LONGEST_TEXT)]
Falloff = Text  # a name that `state` lists
Mode = Text  # a name that `state` lists


class Model(BaseModel):
    """Checked to the letter: no unknown key, no text for a number, no number that is not finite."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class VertexPlace(Model):
    """At a vertex."""

    vertex: Index


class PointPlace(Model):
    """At any point, mesh units."""

    point: Vector


class RegionPlace(Model):
    """A set of vertices as one: `mask` is a bit per vertex, lowest bit first, in bytes written as base64."""

    mask: Annotated[str, Field(min_length=4, pattern=r"^[A-Za-z0-9+/]+={0,2}$")]


Place = VertexPlace | PointPlace | RegionPlace


class Transform(Model):
    """Scale along `axes`, then rotation, then translation, about the pivot.

    Null leaves a part as it is, or at rest where it is new. `rotation` is a rotation vector in degrees or a quaternion;
    `axes` are one a row. "auto" returns a pivot to the handle's own position and axes to the mesh's, and "normal" is a
    frame whose third axis is the surface's normal at the handle.
    """

    translation: Vector | None = None
    rotation: Vector | Quaternion | None = None
    scale: Vector | None = None
    pivot: Vector | Literal["auto"] | None = None
    axes: Frame | Literal["normal", "auto"] | None = None


class Controls(Model):
    """What a handle holds and how; null leaves a control as it is, or at its default where the handle is new."""

    name: Text | None = None
    reach: Annotated[Number, Field(gt=0)] | Literal["auto"] | None = None
    falloff: Falloff | None = None
    locality: Annotated[Number, Field(ge=0)] | None = None
    radius: Annotated[Number, Field(gt=0)] | Annotated[str, Field(pattern=r"^[0-9.]{1,20}%$")] | None = None
    instances: Mode | None = None
    strength: Annotated[Number, Field(ge=0, le=1)] | None = None
    level: bool | None = None
    within: RegionPlace | Literal["everywhere"] | None = None
    within_width: Annotated[Number, Field(ge=0)] | None = None  # mesh units beyond it, over which the handle fades
    without_instances: Annotated[tuple[Index, ...], Field(max_length=MOST_INSTANCES)] | None = None  # vertices
    more: dict[str, JsonValue] | None = None  # further keywords of `Deformer.add` and `Deformer.change`, as they are


class Plane(Model):
    """The plane {p : normal · p = offset}; one that was found tells how alike its sides are."""

    normal: Vector
    offset: Number
    band: Annotated[Number, Field(ge=0)] = 0.0
    score: Number | None = None  # mean distance of mirrored features; 0 is perfect
    name: Text | None = None


class PoseTransform(Model):
    """A handle's part of a key pose; everything as in `Transform`, and nothing left out."""

    handle: Annotated[int, Field(ge=0)]
    translation: Vector
    rotation: Vector
    scale: Vector
    pivot: Vector | None = None
    axes: Frame | None = None


class KeyPose(Model):
    """A stored pose on the timeline."""

    name: Text
    seconds: Annotated[Number, Field(ge=0)]
    transforms: Annotated[tuple[PoseTransform, ...], Field(max_length=MOST_HANDLES)]
