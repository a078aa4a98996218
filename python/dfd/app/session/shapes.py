"""Shapes that a session can open: files, and the samples of the start page."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from dfd.app.options import Source
from dfd.app.protocol.answers import SampleEntry

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

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
