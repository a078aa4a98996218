"""Colors of a surface at any points of its faces, computed from textures, vertex colors and materials."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Int32, Int64, UInt8

WHITE = (1.0, 1.0, 1.0, 1.0)
GRAY = 0.8  # display-referred (sRGB) value of a surface without a material

Wrap = Literal["repeat", "mirror", "clamp"]


@dataclass(frozen=True)
class Material:
    """A surface material; colors are display-referred (sRGB) in [0, 1]."""

    color: tuple[float, float, float, float] = (GRAY, GRAY, GRAY, 1.0)  # RGBA; multiplies texture and vertex colors
    texture: UInt8 | None = None  # (rows, columns, 4) RGBA, first row on top
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")  # how the texture continues outside [0, 1], along u and v
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alpha_cutoff: float = 0.5  # in mode MASK, alpha becomes 0 below this value, and 1 otherwise
    name: str = ""
    # Scale and offset (scale u, scale v, offset u, offset v) of the texture coordinates of a geometry. They are already
    # applied to those of an `Appearance`.
    placement: tuple[float, float, float, float] = (1.0, 1.0, 0.0, 0.0)
    is_default: bool = False  # whether this is a substitute, because the file defines no usable color or texture

    def shown(self, *, has_colors: bool) -> Material:
        """Return the material to display: a default material becomes white if the surface has its own colors."""
        return replace(self, color=WHITE) if self.is_default and has_colors else self


@dataclass(frozen=True)
class Appearance:
    """The colors of the faces of a mesh.

    Face corners refer to *rows*: vertices with one texture coordinate and one color. A seam vertex has several rows.
    """

    corners: Int32  # (R,) mesh vertex of each row; −1 for a row that no face uses
    corner_faces: Int32  # (F, 3) row of each face corner
    face_material: Int32  # (F,) index into `materials`
    materials: tuple[Material, ...]
    uv: Float32 | None = None  # (R, 2) texture coordinates; v points up
    colors: Float32 | None = None  # (R, 4) display-referred RGBA in [0, 1]

    def albedo(self, faces: NDArray[np.integer], barycentric: NDArray[np.floating]) -> Float32:
        """Return the sRGB colors and alpha (N, 4), in [0, 1], of points on `faces` (N,) at `barycentric` (N, 3)."""
        rows = self.corner_faces[faces]
        weights = barycentric.astype(np.float32, copy=False)
        material = self.face_material[faces]
        result: Float32 = np.array([each.color for each in self.materials], np.float32)[material]
        for index, each in enumerate(self.materials):
            if each.texture is not None and self.uv is not None:
                here = slice(None) if len(self.materials) == 1 else np.flatnonzero(material == index)
                result[here] *= _sample(each, blend(self.uv, rows[here], weights[here]))
        if self.colors is not None:
            result *= blend(self.colors, rows, weights)
        for index, each in enumerate(self.materials):
            if each.alpha_mode != "BLEND":
                here = slice(None) if len(self.materials) == 1 else material == index
                result[here, 3] = each.alpha_mode == "OPAQUE" or result[here, 3] >= each.alpha_cutoff
        np.clip(result, 0, 1, out=result)
        return result

    def corner_colors(self, indices: NDArray[np.integer], count: int) -> Float32:
        """Return the colors (`count`, 4) of the indices 0 to `count` − 1. `indices` (F, 3) gives each face corner one.

        The color of an index is the `albedo` at its first face corner, or white if it has no corner.
        """
        colors = np.ones((count, 4), np.float32)
        used, where = np.unique(indices, return_index=True)
        colors[used] = self.albedo(where // 3, np.eye(3, dtype=np.float32)[where % 3])
        return colors

    def content(self) -> Iterator[bytes]:
        """Yield everything on which the results of `albedo` depend, as bytes for a hash."""
        for material in self.materials:
            yield repr((material.color, material.wrap, material.alpha_mode, material.alpha_cutoff)).encode()
        textures = (material.texture for material in self.materials)
        for values in (self.corner_faces, self.face_material, self.uv, self.colors, *textures):
            yield b"none" if values is None else str(values.shape).encode()
            yield b"" if values is None else values.tobytes()


def blend(values: Float32, rows: Int32, weights: Float32) -> Float32:
    """Return weighted sums (N, K) of rows of `values` (R, K): Σ_j weights[i, j] · values[rows[i, j]] for each i."""
    blended: Float32 = weights[:, :1] * values.take(rows[:, 0], axis=0)
    blended += weights[:, 1:2] * values.take(rows[:, 1], axis=0)
    blended += weights[:, 2:] * values.take(rows[:, 2], axis=0)
    return blended


def _sample(material: Material, uv: Float32) -> Float32:
    """Return the texture's RGBA (N, 4) in [0, 1] at `uv` (N, 2), interpolated bilinearly."""
    texture = material.texture
    assert texture is not None
    height, width = texture.shape[:2]
    left, right, across = _texels(uv[:, 0], width, material.wrap[0])
    top, bottom, down = _texels(1 - uv[:, 1], height, material.wrap[1])
    texels = texture.reshape(-1, 4)
    upper = _mix(texels[top * width + left], texels[top * width + right], across)
    lower = _mix(texels[bottom * width + left], texels[bottom * width + right], across)
    return _mix(upper, lower, down) / np.float32(255)


def _texels(coordinate: Float32, size: int, wrap: Wrap) -> tuple[Int64, Int64, Float32]:
    """Return the texels before and after each coordinate (N,), and the fraction (N, 1) of the way between them."""
    period = {"repeat": 1, "mirror": 2, "clamp": 0}[wrap]
    # Whole periods are subtracted first, so that coordinates far from 0 keep their precision.
    coordinate = coordinate - period * np.floor(coordinate / period) if period else coordinate.clip(0, 1)
    position = coordinate * np.float32(size) - np.float32(0.5)
    before = np.floor(position)
    texels = before.astype(np.int64) + [[0], [1]]
    texels = texels % (period * size) if period else texels.clip(0, size - 1)
    if wrap == "mirror":
        texels = np.minimum(texels, 2 * size - 1 - texels)
    return texels[0], texels[1], (position - before)[:, None]


def _mix(a: UInt8 | Float32, b: UInt8 | Float32, fraction: Float32) -> Float32:
    start = a.astype(np.float32, copy=False)
    return start + fraction * (b.astype(np.float32, copy=False) - start)
