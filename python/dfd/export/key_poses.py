"""Key poses: transforms of handles at moments of time, exported as an animation."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.editing.edit import Edit, Handle
from dfd.posing.transforms import Transform


@dataclass(frozen=True)
class KeyPose:
    """The transforms of a session's handles at a moment.

    Raises ValueError if `seconds` is no number or negative, or `transforms` has another key than an id or another value
    than a transform.
    """

    seconds: float  #: At least 0
    transforms: Mapping[int, Transform] = field(default_factory=dict)  #: By the ids of handles; one left out rests
    name: str = ""  #: For display; file formats only name whole animations

    def __post_init__(self) -> None:
        keep = object.__setattr__
        keep(self, "seconds", check.number("KeyPose", "seconds", self.seconds, minimum=0.0))
        if not isinstance(self.transforms, Mapping):
            raise ArgumentError("transforms", f"must be a mapping, got {type(self.transforms).__name__}", "KeyPose")
        for handle, transform in self.transforms.items():
            check.whole("KeyPose", "transforms", handle, minimum=0)
            if not isinstance(transform, Transform):
                raise ArgumentError("transforms", f"must hold transforms, got {type(transform).__name__}", "KeyPose")
        keep(self, "transforms", MappingProxyType(dict(self.transforms)))


def checked_poses(function: str, poses: Sequence[KeyPose], edit: Edit) -> tuple[KeyPose, ...]:
    """Check that `poses` are ordered by time and of handles that `edit` has, and return them.

    Raises ValueError if they are not.
    """
    known = {handle.id for handle in edit.handles}
    before = None
    for pose in poses:
        if not isinstance(pose, KeyPose):
            raise ArgumentError("poses", f"must be key poses, got {type(pose).__name__}", function)
        if before is not None and np.float32(pose.seconds) <= np.float32(before):  # as files store it
            found = f"got one at {pose.seconds:g} s after one at {before:g} s"
            raise ArgumentError("poses", f"must come one after the other in time, {found}", function)
        before = pose.seconds
        unknown = sorted(set(pose.transforms) - known)
        if unknown:
            ids = ", ".join(map(str, sorted(known))) or "none"
            raise ArgumentError("poses", f"must be of handles of the edit ({ids}), got handle {unknown[0]}", function)
    return tuple(poses)


def posed_edit(edit: Edit, pose: KeyPose) -> Edit:
    """`edit` with the transforms of `pose`."""

    def posed(handle: Handle) -> Handle:
        return replace(handle, transform=pose.transforms.get(handle.id, Transform()))

    return replace(edit, handles=tuple(posed(handle) for handle in edit.handles))


Three = tuple[float, float, float]


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class _TransformDocument(_Document):
    handle: Annotated[int, Field(ge=0)]
    translation: Three = (0.0, 0.0, 0.0)
    rotation: Three = (0.0, 0.0, 0.0)
    scale: Three = (1.0, 1.0, 1.0)
    pivot: Three | None = None
    axes: tuple[Three, Three, Three] | None = None
    bend: Three = (0.0, 0.0, 0.0)
    twist: float = 0.0
    joint: Annotated[float, Field(ge=0, le=1)] | None = None


class _PoseDocument(_Document):
    name: str = ""
    seconds: Annotated[float, Field(ge=0)]
    transforms: tuple[_TransformDocument, ...]


_POSES: TypeAdapter[tuple[_PoseDocument, ...]] = TypeAdapter(tuple[_PoseDocument, ...])


def read_key_poses(path: str | os.PathLike[str]) -> tuple[KeyPose, ...]:
    """Read the key poses of a JSON file, such as the app saves of its timeline.

    It is a list of objects with `seconds`, a `name` and `transforms`: objects with the id of a `handle`, a
    `translation` in mesh units, a `rotation` as a rotation vector in degrees, `scale`, `pivot`, `axes`, `bend`,
    `twist` and `joint`, as in an edit.

    Raises OSError if it cannot be read. Raises ValueError if it is malformed; the message names the field and what was
    found there.
    """
    text = Path(path).read_bytes()
    try:
        documents = _POSES.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(map(str, first["loc"])) or "the document"
        raise ValueError(f"read_key_poses: `path` {path}: {where}: {_sentence(first)}") from None
    return tuple(_key_pose(document) for document in documents)


def _sentence(error: Any) -> str:
    found = json.dumps(error["input"], default=str)
    return f"{error['msg'].lower()}, got {found if len(found) <= 60 else found[:59] + '…'}"


def _key_pose(document: _PoseDocument) -> KeyPose:
    transforms = {each.handle: Transform(**each.model_dump(exclude={"handle"})) for each in document.transforms}
    return KeyPose(document.seconds, transforms, document.name)
