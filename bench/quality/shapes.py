"""Shapes with labelled parts: samples, and rigs whose joints name the parts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.quality.parts import FEWEST, kind_of_part, label_vertices, merged, only, strongest_joints
from dfd.common.linear_algebra import Int64

SAMPLES = {make.__name__: make for make in (dfd.samples.chair, dfd.samples.quadruped, dfd.samples.robot)}
UNREADABLE = (ValueError, OSError, KeyError, IndexError, TypeError)  # the errors of a file with a broken skin


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh, and a part per vertex where parts are known."""

    name: str
    mesh: dfd.Mesh
    labels: NDArray[np.integer] | None = None  # (V,) index into `parts`, −1 where a vertex belongs to none
    parts: tuple[str, ...] = ()


def made(faces: int) -> list[Shape]:
    """Return the labelled samples of dfd, of about `faces` faces."""
    samples = {name: make(faces) for name, make in SAMPLES.items()}
    return [Shape(name, sample.mesh, sample.labels, sample.parts) for name, sample in samples.items()]


def characters(folder: Path) -> Iterator[Shape]:
    """Yield every skinned GLB in `folder` with the merged names of its parts, whole and without accessories."""
    for name, whole, names, joints in _skinned(folder):
        if (joints < 0).all():
            continue
        labels, parts = label_vertices(names, joints, merged)
        yield Shape(f"{name}, merged names", whole, labels, parts)
        bare, old = only(whole, joints >= 0)
        if len(old) < len(whole.vertices):
            yield Shape(f"{name} without accessories, merged names", bare, labels[old], parts)


def rigs(folder: Path, *, under: str = "rigs") -> Iterator[Shape]:
    """Yield every skinned GLB in the folder `under` of `folder`, with the kinds of parts of animals and people.

    Files with fewer than two kinds of parts are printed and left out.
    """
    for name, mesh, names, joints in _skinned(folder / under):
        labels, parts = label_vertices(names, joints, kind_of_part, FEWEST)
        if len(parts) > 1:
            yield Shape(name, mesh, labels, parts)
        else:
            print(f"{name}: fewer than two kinds of parts, got {', '.join(parts) or 'none'}")


def _skinned(folder: Path) -> Iterator[tuple[str, dfd.Mesh, tuple[str, ...], Int64]]:
    """Yield every GLB in `folder`: its stem, its mesh in the bind pose, and what `strongest_joints` returns.

    Files that cannot be read are printed and left out.
    """
    for path in sorted(folder.glob("*.glb")):
        try:
            mesh = dfd.load(path, pose="bind")
            found = strongest_joints(mesh)
        except UNREADABLE as error:
            print(f"{path.name}: {error}")
        else:
            yield path.stem, mesh, *found
