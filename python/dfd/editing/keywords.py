"""The keywords of `Deformer.add`, `move` and `change`, with their types, for type checkers and editors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

from numpy.typing import ArrayLike

from dfd.editing.presets import Counterparts
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
