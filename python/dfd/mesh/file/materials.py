"""The appearance of a mesh, from the materials, textures and colors of its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.appearance import Appearance, Material, srgb
from dfd.mesh.file.images import MOST_TEXELS
from dfd.mesh.file.primitives import BareGeometry, Primitive

__all__ = ["read_appearance", "vertex_colors"]

_WHITE = (1.0, 1.0, 1.0, 1.0)


def read_appearance(
    primitives: Sequence[Primitive],
    vertex: NDArray[np.int32],  # (R,) the vertex each row is at
    looks: Mapping[int, Material],
    *,
    linear: bool,
) -> Appearance | None:
    """Return what colors the primitives, None where nothing is known.

    `looks` are known already, by the ids of the geometries' materials; glTF keeps vertex colors `linear`.
    """
    corners: list[NDArray[np.int32]] = []
    corner_faces: list[NDArray[np.int32]] = []
    uvs: list[NDArray[np.float32] | None] = []
    colors: list[NDArray[np.float32] | None] = []
    numbers: dict[tuple[int, bool], int] = {}  # from a material, and whether colors come with it, to our number
    known: list[Material] = []
    face_material: list[NDArray[np.int32]] = []
    surfaces: dict[int, _Surface] = {}
    start = 0
    for each in primitives:
        surface = surfaces.get(id(each.geometry))
        if surface is None:
            surface = surfaces[id(each.geometry)] = _Surface(each, linear)
        rows, faces = vertex[each.rows], surface.faces
        if surface.row_of is not None:
            rows = rows[surface.row_of]
        key = (id(surface.material), surface.colors is not None)
        if key not in numbers:
            numbers[key] = len(known)
            known.append(_look(surface.material, looks, has_colors=key[1]))
        face_material.append(np.full(len(faces), numbers[key], np.int32))
        corners.append(rows)
        corner_faces.append(faces + np.int32(start))
        uvs.append(surface.uv)
        colors.append(surface.colors)
        start += len(rows)
    if all(each.texture is None and each == Material() for each in known) and all(color is None for color in colors):
        return None
    textured = any(each.texture is not None for each in known)
    return Appearance(
        corners=np.concatenate(corners),
        corner_faces=np.concatenate(corner_faces),
        face_material=np.concatenate(face_material),
        materials=tuple(known),
        uv=_stack(uvs, corners, 0.0, 2) if textured else None,
        colors=_stack(colors, corners, 1.0, 4),
    )


class _Surface:
    """What one geometry says about its colors, whatever places show it."""

    def __init__(self, primitive: Primitive, linear: bool) -> None:
        visual = primitive.geometry.visual
        self.faces = primitive.geometry.faces.view(np.ndarray).astype(np.int32)
        self.material = getattr(visual, "material", None)
        self.uv = _texture_coordinates(primitive)
        self.row_of: NDArray[np.int32] | None = None
        if visual is not None and visual.kind == "face":  # a color for each face: its corners are rows of their own
            self.colors: NDArray[np.float32] | None = np.repeat(visual.face_colors.astype(np.float32) / 255, 3, axis=0)
            self.row_of = self.faces.ravel()
            self.faces = np.arange(self.faces.size, dtype=np.int32).reshape(-1, 3)
            self.uv = None
        else:
            self.colors = vertex_colors(primitive, linear=linear)


def _look(source: Any, looks: Mapping[int, Material], has_colors: bool) -> Material:
    """Return a material of trimesh as ours."""
    if id(source) in looks:
        return looks[id(source)]
    if source is None:
        return Material(color=_WHITE) if has_colors else Material()
    from trimesh.visual.material import PBRMaterial, SimpleMaterial

    from dfd.mesh.file.visuals import is_stand_in

    if isinstance(source, PBRMaterial):
        factor = np.ones(4) if source.baseColorFactor is None else np.asarray(source.baseColorFactor) / 255
        color = (*(float(each) for each in srgb(factor[:3])), float(factor[3]))
        mode = cast(Literal["OPAQUE", "MASK", "BLEND"], source.alphaMode or "OPAQUE")
        cutoff = 0.5 if source.alphaCutoff is None else float(source.alphaCutoff)
        return Material(cast(Any, color), _texels(source.baseColorTexture), ("repeat", "repeat"), mode, cutoff)
    if isinstance(source, SimpleMaterial) and not is_stand_in(source):
        texture = _texels(source.image)
        if texture is not None:
            return Material(_WHITE, texture)
        if "kd" in source.kwargs:
            red, green, blue = (float(each) / 255 for each in source.diffuse[:3])
            return Material((red, green, blue, 1.0))
    return Material(color=_WHITE) if has_colors else Material()


def _texels(image: Any) -> NDArray[np.uint8] | None:
    """Return a picture that trimesh opened as RGBA (rows, columns, 4), None for one that is too large."""
    if image is None or image.size[0] * image.size[1] > MOST_TEXELS:
        return None
    return np.asarray(image.convert("RGBA"), np.uint8)


def _texture_coordinates(primitive: Primitive) -> NDArray[np.float32] | None:
    uv = getattr(primitive.geometry.visual, "uv", None)
    if uv is None or np.shape(uv) != (len(primitive.geometry.vertices), 2):
        return None
    coordinates = np.asarray(uv)
    return np.where(np.isfinite(coordinates), coordinates, 0).clip(-1e6, 1e6).astype(np.float32)


def vertex_colors(primitive: Primitive, linear: bool) -> NDArray[np.float32] | None:
    """Return RGBA (rows, 4) in [0, 1], display-referred; glTF keeps `linear` ones."""
    geometry = primitive.geometry
    if isinstance(geometry, BareGeometry):
        return None
    visual = geometry.visual
    if visual.kind == "vertex":
        values = visual.vertex_colors
    else:  # beside a texture
        values = getattr(visual, "vertex_attributes", {}).get("color", geometry.vertex_attributes.get("color"))
    if values is None or np.ndim(values) != 2 or len(values) != len(geometry.vertices):
        return None
    colors = np.asarray(values)
    scale = np.iinfo(colors.dtype).max if colors.dtype.kind in "iu" else 1
    rgba = np.ones((len(colors), 4), np.float32)
    rgba[:, : colors.shape[1]] = colors[:, :4] / scale
    rgba = np.where(np.isfinite(rgba), rgba, 1).clip(0, 1).astype(np.float32)
    if linear:
        rgba[:, :3] = srgb(rgba[:, :3])
    return rgba


def _stack(
    values: Sequence[NDArray[np.float32] | None], corners: Sequence[NDArray[np.int32]], missing: float, width: int
) -> NDArray[np.float32] | None:
    """Return the primitives' values one after the other, `missing` where one has none; None where all have none."""
    if all(each is None for each in values):
        return None
    return np.concatenate(
        [
            np.full((len(rows), width), missing, np.float32) if each is None else each
            for each, rows in zip(values, corners, strict=True)
        ]
    )
