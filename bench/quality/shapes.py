"""Shapes with labelled parts: samples, and rigs whose joints name the parts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.quality.parts import kind_of_part, label_vertices, merged, only, strongest_joints, without_few

SAMPLES = {make.__name__: make for make in (dfd.samples.chair, dfd.samples.quadruped, dfd.samples.robot)}
UNREADABLE = (ValueError, OSError, KeyError, IndexError, TypeError)  # what a file with a broken skin raises


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh, and a part per vertex where parts are known."""

    name: str
    mesh: dfd.Mesh
    labels: NDArray[np.integer] | None = None  # (V,) index into `parts`, −1 where a vertex belongs to none
    parts: tuple[str, ...] = ()


def made(faces: int) -> list[Shape]:
    """The labelled samples of dfd, of about `faces` faces."""
    samples = {name: make(faces) for name, make in SAMPLES.items()}
    return [Shape(name, sample.mesh, sample.labels, sample.parts) for name, sample in samples.items()]


def characters(folder: Path) -> Iterator[Shape]:
    """Yield every skinned GLB in `folder` with the merged names of its parts, whole and without accessories.

    What cannot be read is printed and left out.
    """
    for path in sorted(folder.glob("*.glb")):
        try:
            whole = dfd.load(path, pose="bind")
            joints = strongest_joints(whole)
        except UNREADABLE as error:
            print(f"{path.name}: {error}")
            continue
        skinned = np.array([joint is not None for joint in joints])
        if not skinned.any():
            continue
        bare, old = only(whole, skinned)
        labels, parts = label_vertices(joints, merged)
        yield Shape(f"{path.stem}, merged names", whole, labels, parts)
        if len(old) < len(whole.vertices):
            yield Shape(f"{path.stem} without accessories, merged names", bare, labels[old], parts)


def rigs(folder: Path, *, under: str = "rigs") -> Iterator[Shape]:
    """Every skinned GLB in the folder `under` of `folder`, with kinds of parts by the rule for animals and people.

    What cannot be read, or has no two kinds of parts, is printed and left out.
    """
    for path in sorted((folder / under).glob("*.glb")):
        try:
            yield rig(path)
        except UNREADABLE as error:
            print(f"{path.name}: {error}")


def rig(path: Path) -> Shape:
    """A skinned GLB with kinds of parts by the rule for animals and people.

    Raises ValueError if nothing in it is skinned, its joints have no names, or fewer than two kinds of parts are found.
    """
    mesh = dfd.load(path, pose="bind")
    joints = strongest_joints(mesh)
    if all(joint is None for joint in joints):
        raise ValueError("rig: nothing is skinned")
    if not any(joints):
        raise ValueError("rig: no joint has a name")
    labels, parts = without_few(*label_vertices(joints, kind_of_part))
    if len(parts) < 2:
        raise ValueError(f"rig: fewer than two kinds of parts, got {', '.join(parts) or 'none'}")
    return Shape(path.stem, mesh, labels, parts)
