"""Key poses: the transforms of handles at given times. They are exported as an animation."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.editing.edit import Edit
from dfd.posing.transforms import Transform


@dataclass(frozen=True)
class KeyPose:
    """The transforms of a session's handles at one moment.

    Raises ValueError if `seconds` is not a number or is negative. Raises ValueError if a key of `transforms` is not a
    handle's id, or a value is not a transform.
    """

    seconds: float  #: Time of the pose in the animation, at least 0
    transforms: Mapping[int, Transform] = field(default_factory=dict)  #: By handle id; all other handles are at rest
    name: str = ""  #: Name for display; a glTF file has it only as the name of a morph target

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
    """Return `poses` as a tuple.

    Raises ValueError if an item is not a key pose, is not later than the item before it, or has a handle not in `edit`.
    """
    known = {handle.id for handle in edit.handles}
    before = None
    for pose in poses:
        if not isinstance(pose, KeyPose):
            raise ArgumentError("poses", f"must be key poses, got {type(pose).__name__}", function)
        if before is not None and np.float32(pose.seconds) <= np.float32(before):  # files store 32-bit floats
            found = f"got one at {pose.seconds:g} s after one at {before:g} s"
            raise ArgumentError("poses", f"must come one after the other in time, {found}", function)
        before = pose.seconds
        unknown = sorted(set(pose.transforms) - known)
        if unknown:
            ids = ", ".join(map(str, sorted(known))) or "none"
            raise ArgumentError("poses", f"must use handles of the edit ({ids}), got handle {unknown[0]}", function)
    return tuple(poses)


def posed_edit(edit: Edit, pose: KeyPose) -> Edit:
    """Return `edit` with the transforms of `pose`; all handles without a transform in `pose` are at rest."""
    handles = (replace(each, transform=pose.transforms.get(each.id, Transform())) for each in edit.handles)
    return replace(edit, handles=tuple(handles))


_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True, repr=False)
class _Posed(Transform):
    """A transform in a file of key poses, with the id of its handle."""

    handle: Annotated[int, Field(ge=0)] = field(kw_only=True)

    __pydantic_config__ = _STRICT


@dataclass(frozen=True)
class _Pose:
    seconds: Annotated[float, Field(ge=0)]
    transforms: tuple[_Posed, ...]
    name: str = ""

    __pydantic_config__ = _STRICT


_POSES = TypeAdapter(tuple[_Pose, ...])


def read_key_poses(path: str | os.PathLike[str]) -> tuple[KeyPose, ...]:
    """Return the key poses in a JSON file, for example a timeline that the app saved.

    The file is a list of objects with `seconds`, `transforms` and an optional `name`. Each transform is an object:
    `handle` is the id of its handle, `translation` is in mesh units, and `rotation` is a rotation vector in degrees.
    `scale`, `pivot`, `axes`, `bend`, `twist` and `joint` are as in an edit file.

    Raises OSError if the file cannot be read. Raises ValueError if it is malformed; the message names the JSON
    key and its value.
    """
    text = Path(path).read_bytes()
    try:
        documents = _POSES.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(map(str, first["loc"])) or "the file"
        raise ValueError(f"read_key_poses: `path` {path}: {where}: {_sentence(first)}") from None
    names = [each.name for each in fields(Transform) if each.init]
    return tuple(
        KeyPose(
            pose.seconds,
            {each.handle: Transform(**{name: getattr(each, name) for name in names}) for each in pose.transforms},
            pose.name,
        )
        for pose in documents
    )


def _sentence(error: Any) -> str:
    found = json.dumps(error["input"], default=str)
    return f"{error['msg'].lower()}, got {found if len(found) <= 60 else found[:59] + '…'}"
