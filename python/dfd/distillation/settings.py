"""Define and check the settings of a distillation, which determine the field for a given mesh and encoder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator

from dfd.common import check
from dfd.common.preset import Preset
from dfd.upright.candidates import check_up
from dfd.views.cameras import Framing
from dfd.views.render import LARGEST_RESOLUTION, LARGEST_VIEWS, Supervision

# Pairs of settings of which exactly one is not None: the length of the fit, and the size of its batches.
ALTERNATIVES = (("steps", "epochs"), ("batch", "batch_views"))


Source = Literal["paper", "public code", "ours"]


def _setting(default: Any, description: str, *, paper: Any = ..., source: Source = "paper", **bounds: float) -> Any:
    """Declare a setting: its default, its description, its value in the preset "paper", and its bounds.

    `source` says where the value in the preset "paper" is from. The page `docs/reference/paper.md` shows it.
    """
    extra = {"paper": default if paper is ... else paper, "source": source, "bounds": dict(bounds)}
    return Field(default, description=description, json_schema_extra=extra)


class DistillSettings(BaseModel):
    """The settings of `dfd.distill`, checked and immutable. The preset provides all settings that are not given.

    Raises ValueError if a setting is out of range. Raises ValueError if neither or both of `steps` and `epochs`, or
    of `batch` and `batch_views`, are given. Raises TypeError if a setting is unknown.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    preset: Preset = _setting(
        "default",
        "Source of all settings that are not given: default, the values with the best results; or paper, the paper's.",
        paper="paper",
    )
    views: int = _setting(24, "Number of pictures around the shape.", minimum=1, maximum=LARGEST_VIEWS)
    resolution: int = _setting(
        518,
        "Side of a picture in pixels, rounded to the nearest size that the encoder accepts.",
        paper=512,
        minimum=1,
        maximum=LARGEST_RESOLUTION,
    )
    framing: Framing = _setting(
        "shape",
        "shape: the shape fills every picture; paper: cameras at the distance of the paper's public code.",
        paper="paper",
        source="public code",
    )
    simplify_to: int | None = _setting(
        None,
        "Number of faces of a simplified copy that is rendered; none renders the full mesh, which is not slower.",
        paper=50_000,
        minimum=4,
    )
    up: str | tuple[float, float, float] = _setting(
        "auto",
        "Up direction of the cameras: an axis such as +y or -z; numbers such as 0,0,1; file, for the file's +y; or "
        "auto, found from pictures. Mesh and field keep their coordinates.",
        paper="file",
        source="ours",
    )
    supervision: Supervision = _setting(
        "barycentric",
        "barycentric: fit all covered pixels (Eq. 2); vertex: fit only visible vertices, an ablation of the paper.",
    )
    mirrored: bool = _setting(
        True,
        "Place cameras in groups of four that are mirror images in the two upright middle planes of the shape. This "
        "cancels the encoder's bias between left and right.",
        paper=False,
    )
    background: bool = _setting(
        False, "Encode whole pictures, not only the patches that show the shape.", paper=True, source="public code"
    )
    block: int | None = _setting(
        None,
        "Index, from 1, of the encoder's block whose output is used; none takes the default block.",
        source="ours",
        minimum=1,
    )
    smoothing: float = _setting(
        0.3,
        "Distance over which features are smoothed along the surface before the fit, divided by half the longest side "
        "of the upright shape's bounding box; 0 fits the pixels, as in the paper.",
        paper=0.0,
        minimum=0.0,
        maximum=2.0,
    )
    metric: Literal["learned", "none"] = _setting(
        "learned",
        "learned: map features so that distances separate parts better; none: use the encoder's features, as in the "
        "paper. If no map was learned for the encoder's weights and block, features are not mapped, and "
        "`field.settings` contains `encoder_lacks`. Always none without smoothing.",
        paper="none",
    )
    pieces: bool = _setting(
        True,
        "Correct the features of each connected component, so that a helmet and the head inside it differ. Always off "
        "without smoothing.",
        paper=False,
    )
    octaves: int = _setting(
        5,
        "Octaves of the positional encoding: further inputs of the network, sines and cosines; 0 in the paper.",
        paper=0,
        source="public code",
        minimum=0,
        maximum=check.MOST_OCTAVES,
    )
    width: int = _setting(256, "Number of neurons in each hidden layer.", source="public code", minimum=1, maximum=8192)
    layers: int = _setting(4, "Number of hidden layers of the network.", minimum=1, maximum=64)
    steps: int | None = _setting(350, "Length of the fit in batches, instead of `epochs`.", paper=None, minimum=1)
    epochs: int | None = _setting(
        None, "Length of the fit in passes over all points, instead of `steps`.", paper=15, minimum=1
    )
    batch: int | None = _setting(
        384,
        "Number of surface points in each step of the fit, instead of `batch_views`.",
        paper=None,
        source="public code",
        minimum=1,
    )
    batch_views: int | None = _setting(
        None,
        "Number of pictures whose covered pixels are fitted in each step, instead of `batch`; only without smoothing.",
        paper=2,
        source="public code",
        minimum=1,
        maximum=LARGEST_VIEWS,
    )
    learning_rate: float = _setting(
        2e-2,
        "Learning rate of Adam; with one_cycle, its peak.",
        paper=1e-3,
        source="public code",
        minimum=0.0,
        exclusive=True,
    )
    schedule: Literal["one_cycle", "constant"] = _setting(
        "one_cycle",
        "one_cycle: the learning rate rises to its peak and falls; constant: it does not change.",
        paper="constant",
        source="public code",
    )
    seed: int = _setting(
        0, "Equal seeds give equal fields on one machine.", source="ours", minimum=0, maximum=2**63 - 1
    )

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
        """Add the preset's values. If one of two `ALTERNATIVES` is given, the preset's values of both are left out."""
        preset = check.choice("distill", "preset", given.get("preset", "default"), Preset)
        defaults = {}
        if preset == "paper":
            defaults = {name: _extra(cls, name)["paper"] for name in cls.model_fields}
        for pair in ALTERNATIVES:
            if any(given.get(name) is not None for name in pair):
                defaults |= dict.fromkeys(pair)
        return {**defaults, **given}

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
        for one, other in ALTERNATIVES:
            found = getattr(self, one), getattr(self, other)
            if (found[0] is None) == (found[1] is None):
                got = f"{found[0]} and {found[1]}"
                raise ValueError(f"distill: exactly one of `{one}` and `{other}` must be given, got {got}")
        if self.supervision == "vertex":  # the ablation uses the paper's loss, without smoothing
            object.__setattr__(self, "smoothing", 0.0)
        if self.smoothing == 0:  # `metric` and `pieces` need smoothed features
            object.__setattr__(self, "metric", "none")
            object.__setattr__(self, "pieces", False)
        elif self.batch_views is not None:
            smoothed = f"`smoothing` {self.smoothing:g}, because smoothed points belong to no picture: give `batch`"
            raise ValueError(f"distill: `batch_views` must be None with {smoothed}, got {self.batch_views}")
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


def other_than_paper(made: Mapping[str, Any]) -> list[str]:
    """Return the names of the settings in `made`, those of a field, that differ from the preset "paper"."""
    free = ("seed", "mirrored")  # `mirrored=True` is a variant of the preset
    paper = DistillSettings(preset="paper").as_dict()
    return [name for name, value in paper.items() if name not in free and made.get(name, value) != value]


def _extra(settings: type[DistillSettings], name: str) -> dict[str, Any]:
    extra = settings.model_fields[name].json_schema_extra
    assert isinstance(extra, dict)
    return extra


def source_of(name: str) -> Source:
    """Return where the value of the setting `name` in the preset "paper" is from."""
    source: Source = _extra(DistillSettings, name)["source"]
    return source


DistillSettings.__doc__ = f"""{DistillSettings.__doc__}
    Attributes
    ----------
""" + "".join(f"    {name}\n        {field.description}\n" for name, field in DistillSettings.model_fields.items())
