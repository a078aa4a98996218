"""What a session is started with, as it travels to its process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, JsonValue

from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

UPLOADS = "uploads"  # the folder of uploaded files, inside that of the session


class Source(BaseModel):
    """Where a shape comes from: a sample of that name, or a file, under the name that a person knows it by."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    sample: str | None = None
    path: Path | None = None


class OpenedFile(BaseModel):
    """A field or an edit on disk, under the name that a person knows it by."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    path: Path


class SessionOptions(BaseModel):
    """What every new session opens, and how it makes fields.

    Attributes
    ----------
    mesh, field, edit
        What a new tab shows; None is the start page, no field of its own, no edit.
    preset
        What new sessions start with, and by what fields are distilled.
    encoder, distill
        The encoder's name or folder, and further keywords of `dfd.distill`.
    memory_bytes
        What one session may take; None sets no limit.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    mesh: Source | None = None
    field: OpenedFile | None = None
    edit: OpenedFile | None = None
    preset: Preset = "default"
    encoder: str = DEFAULT_ENCODER
    distill: dict[str, JsonValue] = {}
    memory_bytes: int | None = None

    def distill_arguments(self) -> dict[str, Any]:
        """The keywords for `dfd.distill` and `find_distilled`."""
        preset = {} if self.preset == "default" else {"preset": self.preset}
        return {"encoder": self.encoder, **preset, **self.distill}
