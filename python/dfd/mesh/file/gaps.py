"""Fill gaps in the attributes of a mesh file: one missing value must not discard all others. For all formats."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dfd.common import check
from dfd.common.linear_algebra import Bool, Int32
from dfd.mesh.file.primitives import Geometry, Primitive

WHITE = 1.0


def without_gaps(primitives: Sequence[Primitive], vertex: Int32, path: Path | None) -> tuple[Primitive, ...]:
    """Return the primitives with a value in place of each missing color and texture coordinate, and warn of them.

    In the arrays of a geometry, the row of a missing value is not finite. A missing color becomes white, and a missing
    texture coordinate 0. Missing normals stay: `complete` computes them if a file needs them. `vertex` (R,) is the mesh
    vertex of each row.
    """
    filled: dict[int, Geometry] = {}
    colorless, faceless, unplaced = list[Int32](), 0, list[Int32]()
    for each in primitives:
        old = each.geometry
        if id(old) in filled:
            continue
        used = np.zeros(len(old.vertices), bool)
        used[old.faces] = True
        gaps = {name: _gaps(getattr(old, name)) for name in ("colors", "face_colors", "uv")}
        rows = vertex[each.rows]
        if old.face_colors is None:
            colorless.append(rows[gaps["colors"] & used] if old.colors is not None else rows[:0])
        faceless += int(gaps["face_colors"].sum())
        if old.uv is not None and old.material is not None and old.material.texture is not None:
            unplaced.append(rows[gaps["uv"] & used])
        values = {"colors": WHITE, "face_colors": WHITE, "uv": 0.0}
        changed = {name: _filled(getattr(old, name), gaps[name], values[name]) for name in gaps if gaps[name].any()}
        filled[id(old)] = replace(old, **changed) if changed else old
    vertices = sum(len(np.unique(each)) for each in colorless)
    coordinates = sum(len(np.unique(each)) for each in unplaced)
    found = [f"{_counted(vertices, 'vertex', 'vertices')} without a color"] if vertices else []
    found += [f"{_counted(faceless, 'face', 'faces')} without a color"] if faceless else []
    said = [f"{' and '.join(found)}: white is used"] if found else []
    if coordinates:
        said.append(f"{_counted(coordinates, 'textured vertex', 'textured vertices')} without coordinates: 0 is used")
    if said:
        check.warn(f"load: `path` {path} has {', and '.join(said)}", UserWarning)
    return tuple(
        each if filled[id(each.geometry)] is each.geometry else replace(each, geometry=filled[id(each.geometry)])
        for each in primitives
    )


def _gaps(values: Any) -> Bool:
    """Return which rows (N,) of an array are not finite; for None, no row."""
    return np.zeros(1, bool) if values is None else ~np.isfinite(values).all(axis=1)


def _filled(values: Any, gaps: Bool, value: float) -> Any:
    return np.where(gaps[:, None], np.asarray(value, values.dtype), values)


def _counted(count: int, one: str, several: str) -> str:
    return f"{count} {one if count == 1 else several}"
