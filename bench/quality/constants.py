"""`python -m bench.quality.constants PACKAGE FOLDER`: measure what each constant of a package changes.

Each numeric constant of the modules of `dfd.segmentation` or `dfd.symmetry` is halved, then doubled. FOLDER is that of
`python -m bench.quality people`. For segmentation, the numbers are the mean IoU at level 0, and the best within one
level. For symmetry, the number is that of shapes whose planes change by more than half a degree, or 0.5 % of the
diagonal. A constant that changes none of these numbers by more than their noise needs no rule, or saves only time.
"""

import argparse
import importlib
import pkgutil
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import dfd
from bench.quality import people
from dfd.geometry.topology import face_areas
from dfd.segmentation.parts import Parts

FACTORS = (0.5, 2.0)
ANGLE, OFFSET = np.radians(0.5), 0.005  # planes that differ by less count as equal


def main() -> None:
    """Print a row for each constant and factor."""
    parser = argparse.ArgumentParser("python -m bench.quality.constants", description=__doc__)
    parser.add_argument("package", choices=["segmentation", "symmetry"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=9, help="measure every n-th shape (%(default)s)")
    parser.add_argument("--only", nargs="*", help="names of constants, such as trees.DIFFUSION")
    given = parser.parse_args()
    shapes = [
        (shape, dfd.distill(shape.mesh, progress=False))
        for shape in list(people.people_shapes(given.folder))[:: given.every]
    ]
    measure = (_agreement if given.package == "segmentation" else _planes)(shapes)
    print(f"{len(shapes)} shapes, as they are: {measure()}", flush=True)
    for module, name, value in constants(given.package):
        if not given.only or f"{module.__name__.rpartition('.')[2]}.{name}" in given.only:
            for factor in FACTORS:
                with changed(given.package, name, value, type(value)(value * factor)):
                    print(f"{module.__name__}.{name} {value:g} × {factor:g}: {measure()}", flush=True)


def constants(package: str) -> Iterator[tuple[ModuleType, str, Any]]:
    """Yield the module, the name and the value of each numeric constant that a module of the package defines."""
    for module in _modules(package):
        source = Path(str(module.__file__)).read_text("utf-8")
        for name, value in vars(module).items():
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if number and re.search(rf"^(\w+, )*{name}(, \w+)* = ", source, re.MULTILINE):
                yield module, name, value


@contextmanager
def changed(package: str, name: str, value: Any, other: Any) -> Iterator[None]:
    """Replace a constant in all modules of the package that use it."""
    using = [module for module in _modules(package) if vars(module).get(name) == value]
    try:
        for module in using:
            setattr(module, name, other)
        yield
    finally:
        for module in using:
            setattr(module, name, value)


def _modules(package: str) -> list[ModuleType]:
    path = importlib.import_module(f"dfd.{package}").__path__
    return [importlib.import_module(f"dfd.{package}.{each.name}") for each in pkgutil.iter_modules(path)]


def _agreement(shapes: list[tuple[people.PeopleShape, dfd.Field]]) -> Callable[[], str]:
    """Return a function that measures the agreement of parts with the segments of people."""
    known = []
    for shape, field in shapes:
        areas = face_areas(shape.mesh.vertices, shape.mesh.faces)
        planes, drawn = dfd.symmetry_planes(shape.mesh, field), list(people.places(shape, areas))
        known.append((shape.mesh, field.on(shape.mesh).rows, planes, areas, drawn))

    def measure() -> str:
        found = [
            people._levels(Parts(mesh, rows, lambda planes=planes: planes), mesh, areas, drawn, steps=1)
            for mesh, rows, planes, areas, drawn in known
        ]
        ious = np.concatenate(found)
        return f"{ious[:, 1].mean():.4f} {ious.max(axis=1).mean():.4f}"

    return measure


def _planes(shapes: list[tuple[people.PeopleShape, dfd.Field]]) -> Callable[[], str]:
    """Return a function that counts the shapes whose planes differ from those of the first call."""
    before: list[list[Any]] = []

    def measure() -> str:
        found = [
            [
                np.append(plane.normal, plane.offset / shape.mesh.diagonal)
                for plane in dfd.symmetry_planes(shape.mesh, field)
            ]
            for shape, field in shapes
        ]
        if not before:
            before.extend(found)
        differ = [
            len(one) != len(two) or not all(any(_same_plane(a, b) for b in two) for a in one)
            for one, two in zip(before, found, strict=True)
        ]
        return f"{sum(differ)} of {len(shapes)} differ, {sum(map(len, found))} planes"

    return measure


def _same_plane(one: Any, other: Any) -> bool:
    """Return whether two planes (4,) differ by less than `ANGLE` and `OFFSET`."""
    along = float(one[:3] @ other[:3])
    return bool(abs(along) > np.cos(ANGLE) and abs(one[3] - np.sign(along) * other[3]) < OFFSET)


if __name__ == "__main__":
    main()
