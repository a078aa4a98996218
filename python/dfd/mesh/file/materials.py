"""The appearance of a mesh, from the materials, textures and colours that trimesh read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, cast

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from dfd.mesh.appearance import Appearance, Material, Wrap, srgb
from dfd.mesh.file import gltf_header
from dfd.mesh.file.parts import Part
from dfd.mesh.file.visuals import is_stand_in

__all__ = ["read_appearance", "vertex_colors"]


def read_appearance(
    scene: trimesh.Scene,
    header: dict[str, Any] | None,
    parts: Sequence[Part],
    vertex: NDArray[np.int32],  # (R,) the vertex each row is at
    unreadable: set[str],
) -> Appearance | None:
    """Return what colours the parts, None where nothing is known; add the textures that fail to `unreadable`."""
    reader = _MaterialReader(scene, header, unreadable)
    corners: list[NDArray[np.int32]] = []
    corner_faces: list[NDArray[np.int32]] = []
    uvs: list[NDArray[np.float32] | None] = []
    colors: list[NDArray[np.float32] | None] = []
    materials: dict[int, int] = {}  # from the id of a trimesh material to our number
    known: list[Material] = []
    face_material: list[NDArray[np.int32]] = []
    start = 0
    for part in parts:
        visual, faces = part.geometry.visual, part.geometry.faces.view(np.ndarray).astype(np.int32)
        rows = vertex[part.rows]
        uv, color = _texture_coordinates(part), vertex_colors(part, linear=header is not None)
        if visual.kind == "face":  # a color for each face: its corners are rows of their own
            color = np.repeat(visual.face_colors.astype(np.float32) / 255, 3, axis=0)
            rows, faces = rows[faces.ravel()], np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
        source = getattr(visual, "material", None)
        if id(source) not in materials or source is None:
            materials[id(source)] = len(known)
            known.append(reader.material(part.name, source, has_colors=color is not None))
        face_material.append(np.full(len(faces), materials[id(source)], np.int32))
        corners.append(rows)
        corner_faces.append(faces + np.int32(start))
        uvs.append(uv)
        colors.append(color)
        start += len(rows)
    if all(each == Material() for each in known) and all(color is None for color in colors):
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


class _MaterialReader:
    """Turns trimesh's materials into ours."""

    def __init__(self, scene: trimesh.Scene, header: dict[str, Any] | None, unreadable: set[str]) -> None:
        self._unreadable = unreadable
        self._images: dict[int, NDArray[np.uint8] | None] = {}
        self._header = header
        # what trimesh leaves out of its materials stands in the header, primitive by primitive in the same order
        self._primitives: dict[str, dict[str, Any]] = {}
        if header is not None:
            found = list(gltf_header.primitives(header))
            if len(found) == len(scene.geometry):
                self._primitives = dict(zip(scene.geometry, found, strict=True))

    def material(self, name: str, source: Any, has_colors: bool) -> Material:
        if isinstance(source, PBRMaterial):
            return self._physical(name, source)
        if isinstance(source, SimpleMaterial):
            return self._simple(source, has_colors)
        return Material(color=(1.0, 1.0, 1.0, 1.0)) if has_colors else Material()

    def _physical(self, name: str, source: PBRMaterial) -> Material:
        wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
        image = source.baseColorTexture
        texture = self._texels(image) if image is not None else None
        unknown = image is not None and texture is None
        if self._header is not None and name in self._primitives:
            reference = gltf_header.base_color_texture(self._header, self._primitives[name])
            if reference is not None:
                wrap = gltf_header.wrap(self._header, reference)
                if image is None:
                    unknown = True
                    self._unreadable.add(f"the texture of material {source.name!r}")
        factor = np.ones(4) if source.baseColorFactor is None else np.asarray(source.baseColorFactor) / 255
        color = (*(float(each) for each in srgb(factor[:3])), float(factor[3]))
        mode = cast(Literal["OPAQUE", "MASK", "BLEND"], source.alphaMode or "OPAQUE")
        cutoff = 0.5 if source.alphaCutoff is None else float(source.alphaCutoff)
        return Material(Material().color if unknown else cast(Any, color), texture, wrap, mode, cutoff)

    def _simple(self, source: SimpleMaterial, has_colors: bool) -> Material:
        """An MTL material: its texture alone, or else its diffuse colour; programs disagree about their product."""
        image = source.image
        if image is not None and not is_stand_in(source):
            texture = self._texels(image)
            if texture is not None:
                return Material((1.0, 1.0, 1.0, 1.0), texture)
        elif image is None and "kd" in source.kwargs:
            red, green, blue = (float(each) / 255 for each in source.diffuse[:3])
            return Material((red, green, blue, 1.0))
        return Material(color=(1.0, 1.0, 1.0, 1.0)) if has_colors else Material()

    def _texels(self, image: Image.Image) -> NDArray[np.uint8] | None:
        """Return the image as RGBA (rows, columns, 4), None if it cannot be decoded."""
        if id(image) not in self._images:
            try:
                texels = np.asarray(image.convert("RGBA"), np.uint8)
            except Exception:  # Pillow raises OSError, SyntaxError, ValueError and more on damaged images
                self._unreadable.add(str(image.info.get("file_path", "a damaged texture")))
                texels = None
            self._images[id(image)] = texels
        return self._images[id(image)]


def _texture_coordinates(part: Part) -> NDArray[np.float32] | None:
    uv = getattr(part.geometry.visual, "uv", None)
    if uv is None or np.shape(uv) != (len(part.geometry.vertices), 2):
        return None
    coordinates = np.asarray(uv)
    return np.where(np.isfinite(coordinates), coordinates, 0).clip(-1e6, 1e6).astype(np.float32)


def vertex_colors(part: Part, linear: bool) -> NDArray[np.float32] | None:
    """Return RGBA (rows, 4) in [0, 1], display-referred; glTF keeps linear ones."""
    visual, geometry = part.geometry.visual, part.geometry
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
    """Return the parts' values one after the other, `missing` where a part has none; None where all have none."""
    if all(each is None for each in values):
        return None
    return np.concatenate(
        [
            np.full((len(rows), width), missing, np.float32) if each is None else each
            for each, rows in zip(values, corners, strict=True)
        ]
    )
