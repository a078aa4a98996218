"""Copies of trimesh's geometries with another shape and the same looks."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual import TextureVisuals

__all__ = ["has_image", "rebuilt"]


def rebuilt(
    geometry: trimesh.Trimesh, vertices: NDArray[np.float64], normals: NDArray[np.float64] | None
) -> trimesh.Trimesh:
    """Return `geometry` with other vertices and normals, sharing its materials."""
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


def has_image(geometry: trimesh.Trimesh) -> bool:
    """Whether the geometry's material has a texture."""
    material = getattr(geometry.visual, "material", None)
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    return image is not None and getattr(geometry.visual, "uv", None) is not None


def _copied(visual: Any) -> Any:
    if not isinstance(visual, TextureVisuals):
        return visual.copy()
    copy = TextureVisuals(uv=visual.uv, material=visual.material, face_materials=visual.face_materials)
    colors = visual.vertex_attributes.get("color")
    if colors is not None:  # written as bytes: trimesh would cut floats in [0, 1] down to 0
        scale = np.iinfo(colors.dtype).max if colors.dtype.kind in "iu" else 1
        copy.vertex_attributes["color"] = np.rint(np.clip(colors / scale, 0, 1) * 255).astype(np.uint8)
    return copy
