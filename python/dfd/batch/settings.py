"""The settings of a batch, in the file `batch.json` of its folder."""

from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from dfd.batch.one_edit import EditSource
from dfd.common.files import write_file
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

Step = Literal["inspect", "distill", "features", "symmetry", "parts", "pictures", "edits", "exports"]
STEPS: tuple[Step, ...] = get_args(Step)
# File endings. "same" is that of the shape's own file.
EXPORTS = ("same", "glb", "obj", "ply", "stl", "off", "rig.glb", "weights.npz", "weights.safetensors")


class BatchSettings(BaseModel):
    """All settings that the results of a shape depend on.

    Raises ValueError if a step or an export is unknown, or a step lacks its input.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["dfd-batch"] = "dfd-batch"
    version: Literal[1] = 1
    steps: tuple[Step, ...]
    encoder: str = DEFAULT_ENCODER
    preset: Preset | None = (
        None  # the preset of the planes of symmetry and of all edits; None: default, and each edit's
    )
    distill: dict[str, Any] = Field(default_factory=dict)  # further arguments of `dfd.distill`
    device: str = "cpu"  # torch device of the encoder
    edits: tuple[EditSource, ...] = ()
    threshold: float | None = Field(default=None, ge=0.0, le=1.0)  # as in `dfd.batch.one_edit.carry`
    exports: tuple[str, ...] = ()  # endings from `EXPORTS`

    @field_validator("steps", mode="before")
    @classmethod
    def _ordered(cls, value: Any) -> Any:
        """Return each step once, in the order in which steps run."""
        unknown = [step for step in value if step not in STEPS]
        if unknown or not value:
            raise ValueError(f"`--step` must be one of {', '.join(STEPS)}, got {unknown[0] if unknown else 'none'}")
        return tuple(step for step in STEPS if step in value)

    @field_validator("exports")
    @classmethod
    def _known(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [each for each in value if each not in EXPORTS]
        if unknown:
            raise ValueError(f"`--export` must be one of {', '.join(EXPORTS)}, got {unknown[0]}")
        return value

    def model_post_init(self, context: Any, /) -> None:
        """Raise ValueError if a step lacks its input, or an input lacks its step."""
        for step, given in (("edits", self.edits), ("exports", self.exports)):
            if (step in self.steps) != bool(given):
                raise ValueError(f'`--{step.removesuffix("s")}` and the step "{step}" must be given together')
        if "exports" in self.steps and "edits" not in self.steps:
            raise ValueError('`--step` must include "edits" if it includes "exports", which write the edited shapes')


def begin_folder(root: Path, settings: BatchSettings) -> None:
    """Create the folder of a batch. If the folder already contains a batch, check that it has the same settings.

    Raises ValueError if the folder contains other files, or a batch with other settings. Raises OSError if the
    folder cannot be written.
    """
    file = root / "batch.json"
    if file.is_file():
        try:
            before = BatchSettings.model_validate_json(file.read_bytes())
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise ValueError(f"`--output`: {file} is no batch of this version: {where}: {first['msg']}") from None
        was, now = before.model_dump(mode="json"), settings.model_dump(mode="json")
        differ = ", ".join(f"{key} {was[key]}, now {now[key]}" for key in was if was[key] != now[key])
        if differ:
            raise ValueError(f"`--output`: {root} was begun with other settings ({differ})")
    elif root.is_dir() and any(root.iterdir()):
        raise ValueError(f"`--output` must be a new folder or one of an earlier batch, got {root}")
    root.mkdir(exist_ok=True)
    write_file(file, settings.model_dump_json(indent=2) + "\n", "output")
