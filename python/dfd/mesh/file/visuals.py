"""Copies of trimesh's geometries with another shape and the same looks."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from dfd.mesh.appearance import GREY, linear, srgb
from dfd.mesh.file.primitives import BareGeometry, Geometry

__all__ = ["has_image", "is_stand_in", "rebuilt", "simple"]


def rebuilt(geometry: Geometry, vertices: NDArray[np.float64], normals: NDArray[np.float64] | None) -> trimesh.Trimesh:
    """Return `geometry` with other vertices and normals, sharing its materials."""
    if isinstance(geometry, BareGeometry):
        return BareGeometry(vertices, geometry.faces, normals).to_trimesh()
    return trimesh.Trimesh(
        vertices,
        geometry.faces,
        vertex_normals=normals,
        visual=_copied(geometry.visual),
        metadata={key: value for key, value in geometry.metadata.items() if not key.startswith("_")},
        vertex_attributes=dict(geometry.vertex_attributes),
        face_attributes=dict(geometry.face_attributes),
        process=False,
    )


def has_image(geometry: Geometry) -> bool:
    """Whether the geometry's material has a texture."""
    material = getattr(geometry.visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    return image is not None and getattr(geometry.visual, "uv", None) is not None


def _copied(visual: Any) -> Any:
    if not isinstance(visual, TextureVisuals):
        return visual.copy()
    material = _physical(visual.material)
    if visual.uv is None:
        material = _without_textures(material)
    copy = TextureVisuals(uv=visual.uv, material=material, face_materials=visual.face_materials)
    colors = visual.vertex_attributes.get("color")
    if colors is not None:  # written as bytes: trimesh would cut floats in [0, 1] down to 0
        scale = np.iinfo(colors.dtype).max if colors.dtype.kind in "iu" else 1
        copy.vertex_attributes["color"] = np.rint(np.clip(colors / scale, 0, 1) * 255).astype(np.uint8)
    return copy


def is_stand_in(material: Any) -> bool:
    """Whether trimesh made the material up, with an image of 2 x 2 texels, for a mesh that has none."""
    image = getattr(material, "image", None)
    return isinstance(material, SimpleMaterial) and image is not None and image.size == (2, 2) and image.format is None


def simple(material: Any) -> SimpleMaterial:
    """Return a material as one that an MTL file has room for: a texture, or else a display-referred color."""
    if isinstance(material, SimpleMaterial):
        image, color = material.image, material.diffuse[:3]
    else:
        image, factor = material.baseColorTexture, material.baseColorFactor
        color = np.full(3, 255) if factor is None else np.rint(srgb(np.asarray(factor[:3]) / 255) * 255)
    return SimpleMaterial(image=_lossless(image), diffuse=np.asarray(color, np.uint8), name=material.name)


def _lossless(image: Image.Image | None) -> Image.Image | None:
    """Return a picture that trimesh writes as PNG: JPEG it would compress once more, and visibly."""
    if image is None or image.format == "PNG":
        return image
    return image.copy() if image.mode in ("L", "RGB", "RGBA", "P") else image.convert("RGB")


def _without_textures(material: Any) -> Any:
    """Return a material that names no picture, as glTF asks of what has no texture coordinates."""
    if not isinstance(material, PBRMaterial):
        return material
    names = ("name", "baseColorFactor", "metallicFactor", "roughnessFactor", "doubleSided", "alphaMode", "alphaCutoff")
    plain = PBRMaterial(**{name: getattr(material, name) for name in names})
    if material.emissiveTexture is None:
        plain.emissiveFactor = material.emissiveFactor
    return plain


def _physical(material: Any) -> Any:
    """Return an MTL material as one of glTF that looks the same to us; trimesh would darken its texture."""
    if not isinstance(material, SimpleMaterial):
        return material
    image = None if is_stand_in(material) else material.image
    color = material.diffuse[:3] / 255 if "kd" in material.kwargs else np.full(3, GREY)
    factor = np.ones(3) if image is not None else linear(color)
    return PBRMaterial(
        name=material.name,
        baseColorTexture=_lossless(image),
        baseColorFactor=np.rint([*(factor * 255), 255]).astype(np.uint8),
        metallicFactor=0.0,
        roughnessFactor=1.0,
    )
