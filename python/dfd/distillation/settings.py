"""The settings of a distillation: everything besides mesh and encoder that a field depends on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator

from dfd.common import check
from dfd.common.preset import Preset
from dfd.field.architecture import MOST_OCTAVES
from dfd.upright.candidates import check_up
from dfd.views.cameras import Framing
from dfd.views.render import LARGEST_RESOLUTION, LARGEST_VIEWS, Supervision

LENGTHS = ("steps", "epochs")  # length of a fit: a caller gives one of the two


def _setting(default: Any, description: str, *, paper: Any = ..., **bounds: float) -> Any:
    """Declare one setting: default, description, value in the preset "paper", and bounds."""
    return Field(
        default,
        description=description,
        json_schema_extra={"paper": default if paper is ... else paper, "bounds": dict(bounds)},
    )


class DistillSettings(BaseModel):
    """The settings of `dfd.distill`, checked and immutable; the preset gives those that are left out.

    Raises ValueError if a setting is out of range. Raises ValueError if neither or both of `steps` and `epochs` are
    given. Raises TypeError if there is no setting of a given name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    preset: Preset = _setting(
        "default",
        "Values of the settings left out: as measured to be best (default), or as in the paper (paper).",
        paper="paper",
    )
    views: int = _setting(24, "Pictures taken from around the shape.", minimum=1, maximum=LARGEST_VIEWS)
    resolution: int = _setting(
        518,
        "Pixels along a picture's side, rounded to the nearest that the encoder accepts.",
        paper=512,
        minimum=1,
        maximum=LARGEST_RESOLUTION,
    )
    framing: Framing = _setting(
        "shape", "shape: the shape fills every picture; paper: cameras at a distance of 2.8.", paper="paper"
    )
    simplify_to: int | None = _setting(
        None,
        "Render a copy simplified to this many faces; none casts rays at the full mesh, equally fast below half a "
        "million faces and faster above.",
        paper=50_000,
        minimum=4,
    )
    up: str | tuple[float, float, float] = _setting(
        "auto",
        "Up direction: +y, -z and the like; numbers such as 0,0,1; file, the +y of files by convention; or auto, found "
        "from pictures. It orients the cameras; mesh and field keep their coordinates.",
        paper="file",
    )
    supervision: Supervision = _setting(
        "barycentric",
        "barycentric: fit every covered pixel (Eq. 2); vertex: only those that hold a vertex, the paper's ablation.",
    )
    mirrored: bool = _setting(
        True,
        "Place cameras in fours that mirror each other at the upright middle planes, which cancels the encoder's bias "
        "between left and right.",
        paper=False,
    )
    background: bool = _setting(
        False, "Give the encoder whole pictures, not only the patches that show the shape.", paper=True
    )
    block: int | None = _setting(
        None, "The encoder's block whose tokens are used, from 1; none takes the best one for its weights.", minimum=1
    )
    smoothing: float = _setting(
        0.3,
        "Distance over which features are smoothed along the surface before the fit, relative to half the longest side "
        "of the upright box; 0 fits the pixels, as in the paper.",
        paper=0.0,
        minimum=0.0,
        maximum=2.0,
    )
    metric: Literal["learned", "none"] = _setting(
        "learned",
        "learned: distances that separate parts better, if learned for the encoder's weights and block; none: the "
        "paper's, of the encoder's features alone. Without smoothing always none; what was not learned for an encoder "
        "is in `field.settings` as encoder_lacks.",
        paper="none",
    )
    pieces: bool = _setting(
        True,
        "Store features of each connected component, which separates a helmet from the head inside it. Without "
        "smoothing always off.",
        paper=False,
    )
    octaves: int = _setting(
        5,
        "Octaves of the positional encoding that the network takes in addition to the coordinates; 0 in the paper.",
        paper=0,
        minimum=0,
        maximum=MOST_OCTAVES,
    )
    width: int = _setting(256, "Neurons of each hidden layer of the network.", minimum=1, maximum=8192)
    layers: int = _setting(4, "Hidden layers of the network.", minimum=1, maximum=64)
    steps: int | None = _setting(350, "Length of the fit in batches; or `epochs`.", paper=None, minimum=1)
    epochs: int | None = _setting(None, "Length of the fit in passes over all points; or `steps`.", paper=15, minimum=1)
    batch: int = _setting(384, "Surface points in each step of the fit.", paper=10_000, minimum=1)
    learning_rate: float = _setting(
        2e-2, "Adam's learning rate, or its peak over one cycle.", paper=1e-3, minimum=0.0, exclusive=True
    )
    schedule: Literal["one_cycle", "constant"] = _setting(
        "one_cycle", "one_cycle: the learning rate rises to its peak and falls; constant: it stays.", paper="constant"
    )
    seed: int = _setting(0, "Equal seeds give equal fields on one machine.", minimum=0, maximum=2**63 - 1)

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
        """Add the preset's values, except a second length of the fit."""
        preset = check.choice("distill", "preset", given.get("preset", "default"), Preset)
        usual = {}
        if preset == "paper":
            usual = {name: _extra(cls, name)["paper"] for name in cls.model_fields}
        if any(given.get(name) is not None for name in LENGTHS):
            usual |= dict.fromkeys(LENGTHS)
        return {**usual, **given}

    @field_validator("*", mode="plain")
    @classmethod
    def _check(cls, value: Any, setting: ValidationInfo) -> Any:
        """Check a setting by its annotation and bounds; messages begin with `distill`."""
        name = setting.field_name or ""
        kind, bounds = cls.model_fields[name].annotation, _extra(cls, name)["bounds"]
        kinds = get_args(kind) or (kind,)
        if name == "up":
            return check_up(value)
        if get_origin(kind) is Literal:
            return check.choice("distill", name, value, kind)
        if value is None and type(None) in kinds:
            return None
        if bool in kinds:
            if not isinstance(value, bool | np.bool_):
                raise ValueError(f"distill: `{name}` must be True or False, got {value!r}")
            return bool(value)
        return (check.whole if int in kinds else check.number)("distill", name, value, **bounds)

    @model_validator(mode="after")
    def _fit_together(self) -> DistillSettings:
        if (self.steps is None) == (self.epochs is None):
            raise ValueError(
                f"distill: exactly one of `steps` and `epochs` must be given, got {self.steps} and {self.epochs}"
            )
        if self.supervision == "vertex":  # this ablation uses the paper's loss
            object.__setattr__(self, "smoothing", 0.0)
        if self.smoothing == 0:  # both settings need smoothed features
            object.__setattr__(self, "metric", "none")
            object.__setattr__(self, "pieces", False)
        return self

    def of_encoder(self) -> dict[str, Any]:
        """Return the arguments of `dfd.encoders.encode.load_encoder`."""
        return self.model_dump(include={"block", "background"})

    def of_pictures(self) -> dict[str, Any]:
        """Return the arguments of `dfd.views.render.render`."""
        return self.model_dump(include={"views", "resolution", "framing", "simplify_to", "supervision", "mirrored"})

    def as_dict(self) -> dict[str, Any]:
        """Return all settings by name, as JSON values."""
        return self.model_dump()


def _extra(settings: type[DistillSettings], name: str) -> dict[str, Any]:
    extra = settings.model_fields[name].json_schema_extra
    assert isinstance(extra, dict)
    return extra


DistillSettings.__doc__ = f"""{DistillSettings.__doc__}
    Attributes
    ----------
""" + "".join(f"    {name}\n        {field.description}\n" for name, field in DistillSettings.model_fields.items())
