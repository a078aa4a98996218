"""What a session is started with, as it travels to its process, and the shapes that it can open."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, JsonValue

from dfd.app.protocol.answers import SampleEntry
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

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
    """What every new session opens, and how it makes fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    # mesh, field, edit: what a new tab shows; None is the start page, no field of its own, no edit
    mesh: Source | None = None
    field: OpenedFile | None = None
    edit: OpenedFile | None = None
    preset: Preset = "default"  # what new sessions start with, and by what fields are distilled
    # encoder, distill: the encoder's name or folder, and further keywords of `dfd.distill`
    encoder: str = DEFAULT_ENCODER
    distill: dict[str, JsonValue] = {}
    memory_bytes: int | None = None  # what one session may take; None sets no limit

    def distill_arguments(self) -> dict[str, Any]:
        """The keywords for `dfd.distill` and `find_distilled`."""
        preset = {} if self.preset == "default" else {"preset": self.preset}
        return {"encoder": self.encoder, **preset, **self.distill}


SAMPLES = (
    SampleEntry(name="quadruped", title="Quadruped", faces=20_000),
    SampleEntry(name="chair", title="Chair", faces=20_000),
    SampleEntry(name="robot", title="Robot", faces=20_000),
)


def sample_source(name: str) -> Source:
    """The sample of that name; raises ValueError if there is none."""
    for entry in SAMPLES:
        if entry.name == name:
            return Source(name=entry.title, sample=name)
    raise ValueError(f"There is no sample {name!r}; there are {', '.join(entry.name for entry in SAMPLES)}")


def read_shape(source: Source) -> tuple[Mesh, list[str]]:
    """The mesh of `source`, and the warnings of reading it, without paths of this machine.

    Raises ValueError, OSError as `dfd.load` does.
    """
    if source.sample is not None:
        import dfd.samples as samples

        faces = next(entry.faces for entry in SAMPLES if entry.name == source.sample)
        return getattr(samples, source.sample)(faces).mesh, []
    assert source.path is not None
    from dfd.mesh.mesh import load

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        mesh = load(source.path)
    messages = [str(warning.message) for warning in caught if issubclass(warning.category, UserWarning)]
    return mesh, [message.replace(str(source.path), source.name).removeprefix("load: ") for message in messages]
