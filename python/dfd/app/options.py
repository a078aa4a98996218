"""Options of a session, the files that it opens, and its sample shapes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer
    from dfd.mesh.mesh import Mesh

SAMPLES = ("quadruped", "chair", "robot")  # on the start page
SAMPLE_FACES = 20_000


@dataclass(frozen=True)
class OpenedFile:
    """A file on disk, with the name that the user knows."""

    name: str
    path: Path


Source = OpenedFile | str  # the source of a shape: a file, or the name of a sample


@dataclass(frozen=True)
class Opening:
    """The files to open: a mesh with its field and its edit, or a field and an edit for the open mesh."""

    mesh: Source | None = None
    field: OpenedFile | None = None
    edit: OpenedFile | None = None
    folder: Path | None = None  # folder of an upload; it is deleted when its files are closed


@dataclass(frozen=True)
class SessionOptions(Opening):
    """The files that every new session opens, and its settings. Without a mesh, it opens the start page."""

    preset: Preset = "default"  # of new sessions and of distillation
    encoder: str = DEFAULT_ENCODER  # name or folder
    distill: dict[str, Any] = dataclass_field(default_factory=dict)  # further keywords of `dfd.distill`
    deformer: Deformer | None = None  # the editing session of a notebook, which all pages show

    def distill_arguments(self) -> dict[str, Any]:
        """Return the keywords for `dfd.distill` and `find_distilled`."""
        return {"encoder": self.encoder, "preset": self.preset, **self.distill}


def check_sample(name: str) -> str:
    """Return the name of a sample; raises ValueError if there is no such sample."""
    if name not in SAMPLES:
        raise ValueError(f"There is no sample {name!r}; there are {', '.join(SAMPLES)}")
    return name


@contextmanager
def recorded_warnings() -> Iterator[list[UserWarning]]:
    """Yield a list that holds the UserWarnings of the block once it has ended."""
    messages: list[UserWarning] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield messages
    messages += [each.message for each in caught if isinstance(each.message, UserWarning)]


def read_shape(source: Source) -> tuple[Mesh, list[str]]:
    """Return the mesh of `source`, and the warnings of reading it, without paths of this machine.

    Raises ValueError and OSError as `dfd.load` does.
    """
    if isinstance(source, str):
        import dfd.samples as samples

        return getattr(samples, check_sample(source))(SAMPLE_FACES).mesh, []
    from dfd.mesh.mesh import load

    with recorded_warnings() as messages:
        mesh = load(source.path)
    return mesh, [str(each).replace(str(source.path), source.name).removeprefix("load: ") for each in messages]
