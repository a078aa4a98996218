"""The shapes that the weights are judged on: made ones, and what lies in the folder that DFD_MESHES names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.quality.measures import mirror_image
from bench.quality.parts import kind_of_part, label_vertices, merged, only, sides_as_one, strongest_joints, without_few
from dfd.common.linear_algebra import Float64

# A shape is its own mirror image when so many vertices have another one that near to their images, of the longest side:
# the surface may be the same on both sides where the triangles are not.
MOST, NEAR = 0.95, 0.01
UNREADABLE = (ValueError, OSError, KeyError, IndexError, TypeError)  # what a file with a broken skin raises


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh, and a part per vertex where parts are known."""

    name: str
    mesh: dfd.Mesh
    labels: NDArray[np.integer] | None = None  # (V,) index into `parts`, −1 where a vertex belongs to none
    parts: tuple[str, ...] = ()

    @property
    def image(self) -> Float64:
        """(V, 3) the mirror image of every vertex across the middle of x."""
        return self._mirror[0]

    @property
    def is_its_mirror(self) -> bool:
        """Whether the shape is its own mirror image, or nearly so."""
        return bool(np.quantile(self._mirror[1], MOST) < NEAR)

    @cached_property
    def _mirror(self) -> tuple[Float64, Float64]:
        return mirror_image(self.mesh.vertices)


def made(faces: int) -> list[Shape]:
    """The labelled samples of dfd, of about `faces` faces."""
    found = []
    for make in (dfd.samples.chair, dfd.samples.quadruped, dfd.samples.robot):
        sample = make(faces)
        found.append(Shape(make.__name__, sample.mesh, sample.labels, sample.parts))
    return found


def characters(folder: Path, say: Callable[[str], None]) -> Iterator[Shape]:
    """Every skinned GLB in `folder`, four times: whole and only what is skinned, each by merged and by the rig's names.

    What cannot be read is told to `say` and left out.
    """
    for path in sorted(folder.glob("*.glb")):
        try:
            whole = dfd.load(path, pose="bind")
            joints = strongest_joints(whole)
        except UNREADABLE as error:
            say(f"{path.name}: {error}")
            continue
        skinned = np.array([joint is not None for joint in joints])
        if not skinned.any():
            continue
        bare, old = only(whole, skinned)
        for naming, kind in (("merged", merged), ("rig", sides_as_one)):
            labels, parts = label_vertices(joints, kind)
            yield Shape(f"{path.stem}, {naming} names", whole, labels, parts)
            if len(old) < len(whole.vertices):
                yield Shape(f"{path.stem} without accessories, {naming} names", bare, labels[old], parts)


def rigs(folder: Path, say: Callable[[str], None], *, under: str = "rigs") -> Iterator[Shape]:
    """Every skinned GLB in the folder `under` of `folder`, with kinds of parts by the rule for animals and people.

    What cannot be read, or has no two kinds of parts, is told to `say` and left out.
    """
    for path in sorted((folder / under).glob("*.glb")):
        try:
            yield rig(path)
        except UNREADABLE as error:
            say(f"{path.name}: {error}")


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


def unlabelled(folder: Path | None, name: str) -> Shape | None:
    """A mesh of `folder` without labels, if it is there."""
    path = None if folder is None else folder / name
    return Shape(path.stem, dfd.load(path)) if path is not None and path.is_file() else None
