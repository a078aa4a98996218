"""Meshes whose faces other people have named, in the layout of the Labeled Princeton Segmentation Benchmark.

A folder a category with `N.off` and `N_labels.txt` (a line with a name, and a line with its faces, counted from 1) of
Kalogerakis, Hertzmann and Singh 2010, and of Kim, Lipman and Funkhouser 2011 landmarks in `N.vts` (a vertex and its
position a line) and `counterparts.info` (each line the landmarks that are each other's mirror images).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.quality.measures import area_fractions, components_of
from bench.quality.shapes import Shape, made
from dfd.common.linear_algebra import Float64, Int32, Int64
from dfd.geometry.topology import face_areas

FEW_FACES, FACES = 4_000, 20_000  # of samples


@dataclass(frozen=True, eq=False)
class LabelledShape:
    """A mesh with the parts that people see in it."""

    category: str  # its kind, such as "Ant"
    judged: bool  # whether constants are never chosen on it: half of each category
    shape: Shape  # mesh, and labels of vertices: of the faces around one the most, by area
    landmarks: Int64  # (L,) vertices, −1 where one is missing
    counterparts: tuple[tuple[int, ...], ...]  # groups of numbers of landmarks that mirror one another

    @property
    def labels(self) -> NDArray[np.integer]:
        """(V,) index into the parts' names."""
        return self.shape.labels

    @cached_property
    def areas(self) -> Float64:
        """(V,) how much of the surface belongs to each vertex."""
        return area_fractions(self.shape.mesh)

    @cached_property
    def components(self) -> Int32:
        """(V,) the connected component of its part that each vertex is on: one leg of all legs."""
        sides = self.shape.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        return components_of(sides[self.labels[sides[:, 0]] == self.labels[sides[:, 1]]], len(self.labels))


def labelled_shapes(
    folder: Path | None, *, quick: bool = False, only: Collection[str] | None = None
) -> Iterator[LabelledShape]:
    """Read every labelled mesh of `folder`, or make the samples of dfd if it is None.

    `quick` reads the first of each category that is judged; `only` are the categories that are read, None for all.

    Raises ValueError if there is none, or its files are not of that layout.
    """
    if folder is None:
        for shape in made(FEW_FACES if quick else FACES):
            yield LabelledShape(shape.name, True, shape, np.full(0, -1), ())
        return
    every = sorted(path for path in folder.iterdir() if any(path.glob("*_labels.txt")))
    categories = [path for path in every if only is None or path.name in only]
    if not categories:
        raise ValueError(f"labelled: there is no CATEGORY/N_labels.txt in {folder}")
    for category in categories:
        paths = sorted(category.glob("*.off"), key=lambda path: (len(path.stem), path.stem))
        half = len(paths) // 2
        for number, path in enumerate(paths):
            if not quick or number == half:
                yield _read(path, judged=number >= half)


def _read(path: Path, *, judged: bool) -> LabelledShape:
    mesh = dfd.load(path)
    names, of_face = _face_labels(path.with_name(f"{path.stem}_labels.txt"), len(mesh.faces))
    votes = np.zeros((len(mesh.vertices), len(names)))
    areas = face_areas(mesh.vertices, mesh.faces)
    for corner in mesh.faces.T:
        np.add.at(votes, (corner, of_face), areas)
    shape = Shape(f"{path.parent.name} {path.stem}", mesh, votes.argmax(axis=1), names)
    landmarks = np.full(0, -1)
    if (points := path.with_suffix(".vts")).is_file():
        lines = (line.split() for line in points.read_text("utf-8").splitlines() if line.strip())
        landmarks = np.array([int(line[0]) for line in lines], np.int64)
    return LabelledShape(path.parent.name, judged, shape, landmarks, _counterparts(path.parent / "counterparts.info"))


def _face_labels(path: Path, count: int) -> tuple[tuple[str, ...], Int64]:
    """The parts' names, and (F,) which of them each face has."""
    lines = [line.strip() for line in path.read_text("utf-8").splitlines() if line.strip()]
    labels = np.full(count, -1)
    for number, faces in enumerate(lines[1::2]):
        chosen = np.array(faces.split(), np.int64) - 1
        if chosen.min() < 0 or chosen.max() >= count:
            raise ValueError(f"labelled: {path} names a face that the mesh does not have")
        labels[chosen] = number
    if len(lines) % 2 or (labels < 0).any():
        raise ValueError(f"labelled: {path} leaves faces without a name")
    return tuple(lines[::2]), labels


def _counterparts(path: Path) -> tuple[tuple[int, ...], ...]:
    if not path.is_file():
        return ()
    groups = (tuple(int(number) for number in line.split()) for line in path.read_text("utf-8").splitlines())
    return tuple(group for group in groups if len(group) > 1)
