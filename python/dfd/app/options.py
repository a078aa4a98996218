"""The options of the app's sessions, the files that a session opens, and the names of the sample shapes."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as dataclass_field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.common import check
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.mesh.mesh import Mesh

SAMPLES = ("quadruped", "chair", "robot")  # the sample shapes on the start page
SAMPLE_FACES = 20_000  # approximate number of faces of a sample shape
SAMPLE_FIELDS = Path(__file__).with_name("sample_fields")  # made by `python -m bench.training.sample_fields`


@dataclass(frozen=True)
class OpenedFile:
    """A file on disk, and the name under which the user opened it."""

    name: str
    path: Path
    folder: Path | None = None  # the folder of the upload, in which files that this file names may be anywhere


Source = OpenedFile | str  # the source of a shape: a file, or the name of a sample


@dataclass(frozen=True)
class Opening:
    """The files to open, all optional. If `mesh` is None, field and edit belong to the mesh that is already open."""

    mesh: Source | None = None
    field: OpenedFile | None = None
    edit: OpenedFile | None = None
    folder: Path | None = None  # the folder of uploaded files, which is deleted when the shape is closed


@dataclass(frozen=True)
class SessionOptions(Opening):
    """Settings and files for new sessions. Without `mesh` and `deformer`, a session shows the start page."""

    preset: Preset = "default"  # the preset of new edits and of distillation
    encoder: str = DEFAULT_ENCODER  # the name or the folder of an encoder
    distill: dict[str, Any] = dataclass_field(default_factory=dict)  # further arguments of `dfd.distill`
    deformer: Deformer | None = None  # the editing session of a notebook; all pages show it

    def shipped_field(self, source: Source) -> Path | None:
        """Return the file of a sample's field in the package, or None for another shape or other settings."""
        path = SAMPLE_FIELDS / f"{source}.field.safetensors" if isinstance(source, str) else None
        usual = (self.preset, self.encoder, self.distill) == ("default", DEFAULT_ENCODER, {})
        return path if path is not None and usual and path.is_file() else None

    def distill_arguments(self) -> dict[str, Any]:
        """Return the keyword arguments for `dfd.distill`."""
        return {"encoder": self.encoder, "preset": self.preset, **self.distill}


def check_sample(name: str) -> str:
    """Return `name`; raise ValueError if no sample has this name."""
    if name not in SAMPLES:
        raise ValueError(f"There is no sample {name!r}; the samples are {', '.join(SAMPLES)}")
    return name


def read_shape(source: Source) -> tuple[Mesh, list[str]]:
    """Read the mesh of `source`. Return the mesh, and the reader's warnings without paths of this machine.

    Raises ValueError if no sample has the name `source`. For a file, raises the exceptions of `dfd.load`.
    """
    if isinstance(source, str):
        import dfd.samples as samples

        return getattr(samples, check_sample(source))(SAMPLE_FACES).mesh, []
    from dfd.mesh.mesh import load_within

    with check.recorded_warnings() as messages:
        mesh = load_within(source.path, source.folder)
    return mesh, [str(each).replace(str(source.path), source.name).removeprefix("load: ") for each in messages]


def read_mesh(source: Source) -> Mesh:
    """Read the mesh of `source` without the reader's warnings; raises the errors of `read_shape`."""
    return read_shape(source)[0]
