"""What messages are made of."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, create_model

import dfd.editing.controls as editing

__all__ = [
    "Controls",
    "Frame",
    "Identifier",
    "Index",
    "KeyPose",
    "KeyPoses",
    "Model",
    "Place",
    "Plane",
    "PointPlace",
    "PoseTransform",
    "PoseTransforms",
    "RegionPlace",
    "Text",
    "Transform",
    "Vector",
    "VertexPlace",
]

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w
Frame = tuple[Vector, Vector, Vector]
Index = Annotated[int, Field(ge=0)]
Identifier = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Text = Annotated[str, Field(min_length=1, max_length=1000)]


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


class ControlsBase(Model):
    """What a handle holds and how; null leaves a control as it is, or at its default where the handle is new."""

    name: Text | None = None


# Controls that are another type in messages than in an edit.
CONTROL_TYPES: dict[str, Any] = {
    "radius": float | str,
    "within": RegionPlace | Literal["everywhere"],
    "without_instances": Annotated[tuple[Index, ...], Field(max_length=1000)],  # vertices
}

if TYPE_CHECKING:
    Controls = ControlsBase
else:
    hints = {**get_type_hints(editing.Controls, {**vars(editing), "Mesh": Any}), **CONTROL_TYPES}
    Controls = create_model(
        "Controls",
        __base__=ControlsBase,
        __doc__=ControlsBase.__doc__,
        **{each.name: (hints[each.name] | None, None) for each in fields(editing.Controls)},
    )


class Plane(Model):
    """The plane {p : normal · p = offset}; one that was found tells how similar its sides are."""

    normal: Vector
    offset: float
    band: Annotated[float, Field(ge=0)] = 0.0
    score: float | None = None  # mean distance of mirrored features; 0 is perfect
    name: Text | None = None


class PoseTransform(Model):
    """A handle's part of a key pose; everything as in `Transform`, and nothing left out."""

    handle: Index
    translation: Vector
    rotation: Vector
    scale: Vector
    pivot: Vector | None = None
    axes: Frame | None = None


PoseTransforms = Annotated[tuple[PoseTransform, ...], Field(max_length=1000)]


class KeyPose(Model):
    """A stored pose on the timeline."""

    name: Text
    seconds: Annotated[float, Field(ge=0)]
    transforms: PoseTransforms


KeyPoses = Annotated[tuple[KeyPose, ...], Field(max_length=1000)]
