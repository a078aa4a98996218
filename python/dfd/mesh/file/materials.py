"""The appearance of a mesh, from the materials, textures and colors of its primitives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64, Int32
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.file.primitives import Primitive

_DEFAULT = Material(is_default=True)


def read_appearance(
    primitives: Sequence[Primitive],
    vertex: Int32,  # (R,) the vertex of each row
    corner_faces: Int32,  # (F, 3)
) -> Appearance | None:
    """Return the appearance of the primitives; None if the file defines none."""
    numbers: dict[tuple[int, bool], int] = {}  # from a material, and whether its surface has colors, to our number
    known: list[Material] = []
    of_primitive: list[int] = []
    for each in primitives:
        material, has_colors = each.geometry.material or _DEFAULT, _has_colors(each)
        of_primitive.append(numbers.setdefault((id(material), has_colors), len(known)))
        if of_primitive[-1] == len(known):
            known.append(material.shown(has_colors=has_colors))
    colored = any(_has_colors(each) for each in primitives)
    if not colored and all(each.texture is None and replace(each, name="", is_default=False) == Material()
                           for each in known):  # fmt: skip
        return None
    face_counts = [each.faces.stop - each.faces.start for each in primitives]
    uv: Float32 | None = None
    colors: Float32 | None = None
    if any(each.texture is not None for each in known) and any(each.geometry.uv is not None for each in primitives):
        uv = np.concatenate([_or_fill(_clipped(each.geometry.uv), each, 0.0, 2) for each in primitives])
    if any(each.geometry.face_colors is not None for each in primitives):  # corners are rows of their own
        corner = corner_faces.ravel()
        colors = np.concatenate(
            [
                _or_fill(each.geometry.colors, each, 1.0, 4)[corner_faces[each.faces].ravel() - each.rows.start]
                if each.geometry.face_colors is None
                else np.repeat(each.geometry.face_colors, 3, axis=0)
                for each in primitives
            ]
        )
        vertex, uv = vertex[corner], None if uv is None else uv[corner]
        corner_faces = np.arange(len(corner), dtype=np.int32).reshape(-1, 3)
    elif colored:
        colors = np.concatenate([_or_fill(each.geometry.colors, each, 1.0, 4) for each in primitives])
    return Appearance(
        corners=vertex,
        corner_faces=corner_faces,
        face_material=np.repeat(np.array(of_primitive, np.int32), face_counts),
        materials=tuple(known),
        uv=uv,
        colors=colors,
    )


def rgba(values: NDArray[Any]) -> Float32:
    """Return colors (N, 3 or 4) as RGBA (N, 4) in [0, 1]; integers are divided by the largest of their type."""
    scale = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1
    result = np.ones((len(values), 4), np.float32)
    result[:, : values.shape[1]] = values[:, :4] / scale
    return np.where(np.isfinite(result), result, 1).clip(0, 1).astype(np.float32)


def _has_colors(each: Primitive) -> bool:
    return each.geometry.colors is not None or each.geometry.face_colors is not None


def _clipped(uv: Float64 | None) -> Float32 | None:
    return None if uv is None else np.where(np.isfinite(uv), uv, 0).clip(-1e6, 1e6).astype(np.float32)


def _or_fill(values: Float32 | None, each: Primitive, missing: float, width: int) -> Float32:
    return np.full((len(each.geometry.vertices), width), missing, np.float32) if values is None else values
