"""The settings of a batch, in the file `batch.json` of its folder."""

from __future__ import annotations

import hashlib
import json
from typing import Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, field_validator

from dfd.encoders.known import DEFAULT_ENCODER

Step = Literal["inspect", "distill", "features", "symmetry", "parts", "pictures", "edits", "exports"]
STEPS: tuple[Step, ...] = get_args(Step)
# What `exports` can be, which is also how the files' names end: moved shapes, and what other programs pose.
MOVED = ("glb", "obj", "ply", "stl", "off")
RIGS = ("rig.glb", "rig.usdc", "rig.usdz")
WEIGHTS = ("weights.npz", "weights.safetensors")
EXPORTS = (*MOVED, *RIGS, *WEIGHTS)


class EditSource(BaseModel):
    """An edit that is carried to every shape: its name, and the hash of the edit, its mesh and its field together."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    mesh: str  # the name of its file in the batch's folder `edits`
    sha256: str


class BatchSettings(BaseModel):
    """All settings that the results of a shape depend on.

    Raises ValueError if a step or format is unknown, or a step lacks what it works on.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["dfd-batch"] = "dfd-batch"
    version: Literal[1] = 1
    steps: tuple[Step, ...]
    encoder: str = DEFAULT_ENCODER
    distill: dict[str, Any] = Field(default_factory=dict)
    device: str = "cpu"
    edits: tuple[EditSource, ...] = ()
    threshold: float | None = Field(default=None, ge=0.0, le=1.0)
    exports: tuple[str, ...] = ()
    sharded: bool = False

    @field_validator("steps", mode="before")
    @classmethod
    def _ordered(cls, value: Any) -> Any:
        """Each once, in the order in which they work."""
        unknown = [step for step in value if step not in STEPS]
        if unknown:
            raise ValueError(f"`--step` must be of {', '.join(STEPS)}, got {unknown[0]}")
        if not value:
            raise ValueError(f"`--step` must name at least one of {', '.join(STEPS)}")
        return tuple(step for step in STEPS if step in value)

    @field_validator("exports")
    @classmethod
    def _known(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [each for each in value if each not in EXPORTS]
        if unknown:
            raise ValueError(f"`--export` must be of {', '.join(EXPORTS)}, got {unknown[0]}")
        return value

    def model_post_init(self, context: Any, /) -> None:
        """Refuse steps that have nothing to work on."""
        for step, name in (("edits", "edits"), ("exports", "exports")):
            if (step in self.steps) != bool(getattr(self, name)):
                raise ValueError(f"`--{name.removesuffix('s')}` and the step {step} must be given together")
        if "exports" in self.steps and "edits" not in self.steps:
            raise ValueError("`--step` must hold edits for exports: they are what is written")

    def hash(self) -> str:
        """SHA-256, 64 hexadecimal digits: records with another hash are not reused."""
        return hashlib.sha256(json.dumps(self.model_dump(mode="json"), sort_keys=True).encode()).hexdigest()

    @property
    def needs_field(self) -> bool:
        """Whether a step asks for a field."""
        return bool({"features", "symmetry", "parts", "edits", "exports"} & set(self.steps))
