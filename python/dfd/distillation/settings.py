"""What a field depends on besides its mesh and its encoder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, ValidationInfo, model_validator

from dfd.common import check
from dfd.common.preset import Preset
from dfd.field.architecture import MOST_OCTAVES
from dfd.upright.candidates import check_up
from dfd.views.cameras import Framing
from dfd.views.render import LARGEST_RESOLUTION, LARGEST_VIEWS, Supervision

__all__ = ["LENGTHS", "PRESETS", "DistillOptions", "DistillSettings", "MetricChoice", "Schedule"]

MetricChoice = Literal["learned", "none"]
Schedule = Literal["one_cycle", "constant"]

# What each preset takes where a call says nothing else.
PRESETS: dict[Preset, dict[str, Any]] = {
    "default": {},
    "paper": {
        "resolution": 512,
        "framing": "paper",
        "simplify_to": 50_000,
        "up": "file",
        "mirrored": False,
        "background": True,
        "smoothing": 0.0,
        "metric": "none",
        "pieces": False,
        "octaves": 0,
        "epochs": 15,
        "batch": 10_000,
        "learning_rate": 1e-3,
        "schedule": "constant",
    },
}
LENGTHS = ("steps", "epochs")  # of a fit: one of the two


def _checked(how: Callable[..., Any], *given: Any, **bounds: Any) -> PlainValidator:
    """Let `how`, of `dfd.common.check`, look at a setting in the name of `distill`."""

    def look(value: Any, setting: ValidationInfo) -> Any:
        return how("distill", setting.field_name, value, *given, **bounds)

    return PlainValidator(look)


def _whole(minimum: int, maximum: int | None = None, *, or_none: bool = False) -> PlainValidator:
    def whole(function: str, name: str, value: Any) -> int | None:
        return (
            None if or_none and value is None else check.whole(function, name, value, minimum=minimum, maximum=maximum)
        )

    return _checked(whole)


def _switch(function: str, name: str, value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{function}: `{name}` must be True or False, got {value!r}")
    return bool(value)


def _up(function: str, name: str, value: Any) -> str | tuple[float, float, float]:
    return check_up(value)


class DistillSettings(BaseModel):
    """The settings of `dfd.distill`; they check themselves when made, and never change.

    Every one that is left out is the preset's.

    Raises
    ------
    ValueError
        If one is out of its range, or neither or both of `steps` and `epochs` are given.
    TypeError
        If there is no such setting.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    preset: Annotated[
        Preset,
        _checked(check.choice, Preset),
        Field(
            description="What is left out is as it was measured to be best (default) or as the paper has it (paper)."
        ),
    ] = "default"
    views: Annotated[int, _whole(1, LARGEST_VIEWS), Field(description="Pictures taken from around the shape.")] = 24
    resolution: Annotated[
        int,
        _whole(1, LARGEST_RESOLUTION),
        Field(description="Pixels along a picture's side; the nearest that the encoder takes is taken."),
    ] = 518
    framing: Annotated[
        Framing,
        _checked(check.choice, Framing),
        Field(description="shape: it fills every picture; paper: cameras at a distance of 2.8."),
    ] = "shape"
    simplify_to: Annotated[
        int | None,
        _whole(4, or_none=True),
        Field(
            description="Take the pictures of a copy of at most so many faces; none casts rays at the mesh itself, as "
            "fast below half a million faces and faster above."
        ),
    ] = None
    up: Annotated[
        str | tuple[float, float, float],
        _checked(_up),
        Field(
            description="Which way is up: +y, -z and the like; numbers such as 0,0,1; file, the +y that files have by "
            "convention; or auto, which looks. Cameras stand upright in it; mesh and field keep their coordinates."
        ),
    ] = "auto"
    supervision: Annotated[
        Supervision,
        _checked(check.choice, Supervision),
        Field(
            description="barycentric: fit every covered pixel (Eq. 2); vertex: only those that hold a vertex, the "
            "paper's ablation."
        ),
    ] = "barycentric"
    mirrored: Annotated[
        bool,
        _checked(_switch),
        Field(
            description="Take the pictures in fours that mirror each other at the upright middle planes: the encoder's "
            "own sense of left and right evens out."
        ),
    ] = True
    background: Annotated[
        bool,
        _checked(_switch),
        Field(description="Let the encoder look at all of a picture, not only at patches that show the shape."),
    ] = False
    block: Annotated[
        int | None,
        _whole(1, or_none=True),
        Field(
            description="The encoder's block whose tokens are taken, from 1; none is the one that suits its weights."
        ),
    ] = None
    smoothing: Annotated[
        float,
        _checked(check.number, minimum=0.0, maximum=2.0),
        Field(
            description="How far features spread along the surface before the fit, as a part of half the longest side "
            "of the box; 0 fits the pixels as they are, as the paper does."
        ),
    ] = 0.3
    metric: Annotated[
        MetricChoice,
        _checked(check.choice, MetricChoice),
        Field(
            description="learned: distances that tell parts apart better, where some were learned for the encoder's "
            "weights and block; none: the paper's, of what is seen alone. Without smoothing always none; what was not "
            "learned for an encoder is in `field.settings` as encoder_lacks."
        ),
    ] = "learned"
    pieces: Annotated[
        bool,
        _checked(_switch),
        Field(
            description="Keep what each of several unconnected pieces looks like, so that a helmet is told from the "
            "head in it. Without smoothing never."
        ),
    ] = True
    octaves: Annotated[
        int,
        _whole(0, MOST_OCTAVES),
        Field(
            description="Wavelengths of the sines that the network is given beside the coordinates; the paper's has 0."
        ),
    ] = 5
    width: Annotated[int, _whole(1, 8192), Field(description="Neurons of each hidden layer of the network.")] = 256
    layers: Annotated[int, _whole(1, 64), Field(description="Hidden layers of the network.")] = 4
    steps: Annotated[int | None, _whole(1, or_none=True), Field(description="Length of the fit; or `epochs`.")] = 350
    epochs: Annotated[
        int | None,
        _whole(1, or_none=True),
        Field(description="Length of the fit in rounds, each over every point once; or `steps`."),
    ] = None
    batch: Annotated[int, _whole(1), Field(description="Surface points in each step of the fit.")] = 384
    learning_rate: Annotated[
        float,
        _checked(check.number, minimum=0.0, exclusive=True),
        Field(description="Adam's rate, or the peak of one that rises and falls."),
    ] = 2e-2
    schedule: Annotated[
        Schedule,
        _checked(check.choice, Schedule),
        Field(description="one_cycle: the rate rises to its peak and falls; constant: it stays."),
    ] = "one_cycle"
    seed: Annotated[int, _whole(0, 2**63 - 1), Field(description="Equal seeds give equal fields on one machine.")] = 0

    if not TYPE_CHECKING:

        def __init__(self, **given: Any) -> None:
            try:
                super().__init__(**given)
            except ValidationError as error:
                first = error.errors()[0]
                if first["type"] == "extra_forbidden":
                    raise TypeError(f"distill() got an unexpected keyword argument {first['loc'][0]!r}") from None
                raise first["ctx"]["error"] from None

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, given: Mapping[str, Any]) -> dict[str, Any]:
        """Take from the preset what is not given, but not a length of the fit beside the one that is."""
        preset = check.choice("distill", "preset", given.get("preset", "default"), Preset)
        if any(given.get(name) is not None for name in LENGTHS):
            given = {**dict.fromkeys(LENGTHS), **given}
        elif "epochs" in PRESETS[preset]:
            given = {**given, "steps": None, "epochs": given.get("epochs", PRESETS[preset]["epochs"])}
        return {**PRESETS[preset], **given}

    @model_validator(mode="after")
    def _fit_together(self) -> DistillSettings:
        if (self.steps is None) == (self.epochs is None):
            raise ValueError(
                f"distill: exactly one of `steps` and `epochs` must be given, got {self.steps} and {self.epochs}"
            )
        if self.supervision == "vertex":  # the ablation is of the paper's own loss
            object.__setattr__(self, "smoothing", 0.0)
        if self.smoothing == 0:  # both are of features that have spread
            object.__setattr__(self, "metric", "none")
            object.__setattr__(self, "pieces", False)
        return self

    def of_encoder(self) -> dict[str, Any]:
        """Return what `dfd.encoders.encode.load_encoder` goes by."""
        return self._some("block", "background")

    def of_pictures(self) -> dict[str, Any]:
        """Return what `dfd.views.render.render` goes by."""
        return self._some("views", "resolution", "framing", "simplify_to", "supervision", "mirrored")

    def of_fit(self) -> dict[str, Any]:
        """Return what a fit goes by."""
        network, length = ("octaves", "width", "layers"), ("steps", "epochs", "batch", "learning_rate", "schedule")
        return self._some("preset", *network, *length, "seed")

    def _some(self, *names: str) -> dict[str, Any]:
        return {name: getattr(self, name) for name in names}

    def as_dict(self) -> dict[str, Any]:
        """Return all settings by name, as JSON holds them."""
        return self.model_dump()


DistillSettings.__doc__ = f"""{DistillSettings.__doc__}
    Attributes
    ----------
""" + "".join(f"    {name}\n        {field.description}\n" for name, field in DistillSettings.model_fields.items())


class DistillOptions(TypedDict, total=False):
    """The same names and types, for programs that check the keywords of `dfd.distill` without running it."""

    preset: Preset
    views: int
    resolution: int
    framing: Framing
    simplify_to: int | None
    up: str | tuple[float, float, float]
    supervision: Supervision
    mirrored: bool
    background: bool
    block: int | None
    smoothing: float
    metric: MetricChoice
    pieces: bool
    octaves: int
    width: int
    layers: int
    steps: int | None
    epochs: int | None
    batch: int
    learning_rate: float
    schedule: Schedule
    seed: int
