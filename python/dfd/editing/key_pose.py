"""Key poses of an edit: the transforms of its handles at given times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np

from dfd.common import check
from dfd.common.described import About, Written, about
from dfd.common.errors import ArgumentError
from dfd.posing.transforms import Transform


@dataclass(frozen=True, repr=False)
class PosedHandle(Transform):
    """A transform in a file, with the id of its handle."""

    handle: Annotated[int, About("Identifier of the handle.", 1.0)] = field(kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check.whole("PosedHandle", "handle", self.handle, minimum=1)

    @property
    def transform(self) -> Transform:
        """Return the transform without the id."""
        return Transform(**{name: getattr(self, name) for name in _MOTIONS})


def _written(transforms: Mapping[int, Transform]) -> list[dict[str, Any]]:
    return [
        {"handle": handle, **{name: getattr(transform, name) for name in _MOTIONS}}
        for handle, transform in transforms.items()
    ]


@dataclass(frozen=True)
class KeyPose:
    """The transforms of a session's handles at one moment.

    Raises ValueError if `seconds` is not a number or is negative, or `name` is no text that a file can store. Raises
    ValueError if a key of `transforms` is not a handle's id, or a value is not a transform.

    Parameters
    ----------
    seconds
        Time of the pose in the animation.
    transforms
        A `dfd.Transform` for each handle that moves, by the handle's id, or an affine matrix (3, 4) or (4, 4) in mesh
        units. All other handles are at rest.
    name
        Name for display. A glTF file has it only as the name of a morph target.
    ease
        Whether motions slow down towards the pose and start slowly from it. Otherwise, their speed is constant.
    """

    seconds: Annotated[float, About("Time of the pose in the animation.", 0.0)]
    transforms: Annotated[Mapping[int, Transform], Written(tuple[PosedHandle, ...], _written)] = field(
        default_factory=dict
    )
    name: Annotated[str, About("Name for display. A glTF file has it only as the name of a morph target.")] = ""
    ease: Annotated[bool, About("Whether motions slow down towards the pose and start slowly from it.")] = False

    def __post_init__(self) -> None:
        keep = object.__setattr__
        keep(self, "seconds", check.number("KeyPose", "seconds", self.seconds, minimum=0.0))
        name: object = self.name
        if not isinstance(name, str) or any("\ud800" <= letter <= "\udfff" for letter in name):
            raise ArgumentError("name", f"must be text that can be written to a file, got {self.name!r}", "KeyPose")
        if not isinstance(self.ease, bool):
            raise ArgumentError("ease", f"must be True or False, got {self.ease!r}", "KeyPose")
        given = self.transforms
        if isinstance(given, tuple) and all(isinstance(each, PosedHandle) for each in given):
            ids = [each.handle for each in given]
            if twice := [handle for handle in ids if ids.count(handle) > 1]:
                raise ArgumentError("transforms", f"must have each handle once, got handle {twice[0]} twice", "KeyPose")
            given = {each.handle: each.transform for each in given}
        if not isinstance(given, Mapping):
            raise ArgumentError("transforms", f"must be a mapping, got {type(given).__name__}", "KeyPose")
        found = {}
        for handle, transform in given.items():
            check.whole("KeyPose", "transforms", handle, minimum=1)
            if not isinstance(transform, Transform):
                if np.ndim(transform) != 2:
                    must = f"must hold transforms or matrices (3, 4), got {type(transform).__name__}"
                    raise ArgumentError("transforms", must, "KeyPose")
                transform = Transform.of_matrix(transform)
            found[handle] = transform
        keep(self, "transforms", MappingProxyType(found))

    def __hash__(self) -> int:
        return hash((self.seconds, tuple(self.transforms.items()), self.name, self.ease))

    def without(self, handle: int) -> KeyPose:
        """Return the pose without the transform of a handle."""
        kept = {known: transform for known, transform in self.transforms.items() if known != handle}
        return replace(self, transforms=kept)


_MOTIONS = tuple(name for name in about(Transform) if name != "linear")
