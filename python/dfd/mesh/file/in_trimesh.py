"""Conversion of trimesh meshes and scenes to a `SceneFile`."""

from collections.abc import Mapping
from typing import Any, Literal, cast

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from dfd.common.linear_algebra import UInt8
from dfd.mesh.appearance import WHITE, Material
from dfd.mesh.colors import rgba, srgb
from dfd.mesh.file.assets import MOST_TEXELS
from dfd.mesh.file.primitives import IDENTITY, Geometry, MeshInstance
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.file.shading import SMOOTH
from dfd.mesh.images import as_texels


def of_trimesh(source: trimesh.Trimesh | trimesh.Scene) -> SceneFile:
    """Return a trimesh object as a scene, with copies of its arrays; raise ValueError if the object is not valid."""
    if isinstance(source, trimesh.Trimesh):
        geometry = _geometry(source.copy())
        instances = [MeshInstance(str(source.metadata.get("name") or "mesh"), "mesh", geometry)]
        return SceneFile.of(None, instances, own_vertices=geometry.vertices)
    meshes = {name: each for name, each in source.geometry.items() if isinstance(each, trimesh.Trimesh)}
    copies = {name: _geometry(each.copy()) for name, each in meshes.items()}
    instances = []
    for node in source.graph.nodes_geometry:
        transform, name = source.graph[node]
        if name in copies:
            matrix = IDENTITY if np.array_equal(transform, IDENTITY) else np.asarray(transform, np.float64)
            instances.append(MeshInstance(str(node), name, copies[name], matrix))
    return SceneFile.of(None, instances)


def _geometry(mesh: trimesh.Trimesh) -> Geometry:
    visual = mesh.visual
    material = getattr(visual, "material", None)
    count = len(mesh.vertices)
    uv = getattr(visual, "uv", None)
    if visual.kind == "vertex":
        colors = visual.vertex_colors
    else:  # trimesh stores the vertex colors of a textured mesh as an attribute
        colors = getattr(visual, "vertex_attributes", {}).get("color", mesh.vertex_attributes.get("color"))
    if colors is not None and (np.ndim(colors) != 2 or len(colors) != count):
        colors = None
    # The property `vertex_normals` would compute missing normals; the cache does not.
    normals = mesh._cache.cache.get("vertex_normals")
    return Geometry(
        np.asarray(mesh.vertices, np.float64),
        np.asarray(mesh.faces, np.int64),
        None if normals is None else np.asarray(normals, np.float64),
        np.asarray(uv, np.float64) if uv is not None and np.shape(uv) == (count, 2) else None,
        None if colors is None else rgba(np.asarray(colors)),
        rgba(np.asarray(visual.face_colors)) if visual.kind == "face" else None,
        None if material is None or _is_default_material(material) else _material(material),
        {
            name: np.asarray(each)
            for name, each in mesh.vertex_attributes.items()
            if name != "color" and len(each) == count
        },
        smoothing=np.full(len(mesh.faces), SMOOTH),
    )


def _is_default_material(material: Any) -> bool:
    """Return whether `material` is trimesh's substitute for a missing material: it has an image of 2 × 2 texels."""
    image = getattr(material, "image", None)
    return isinstance(material, SimpleMaterial) and image is not None and image.size == (2, 2) and image.format is None


def _material(source: Any) -> Material:
    name = str(getattr(source, "name", None) or "")
    if isinstance(source, PBRMaterial):
        factor = np.ones(4) if source.baseColorFactor is None else np.asarray(source.baseColorFactor) / 255
        color = (*(float(each) for each in srgb(factor[:3])), float(factor[3]))
        mode = cast(Literal["OPAQUE", "MASK", "BLEND"], source.alphaMode or "OPAQUE")
        cutoff = 0.5 if source.alphaCutoff is None else float(source.alphaCutoff)
        return Material(
            cast(Any, color), _texels(source.baseColorTexture), alpha_mode=mode, alpha_cutoff=cutoff, name=name
        )
    texture = _texels(getattr(source, "image", None))
    if texture is not None:
        return Material(WHITE, texture, name=name)
    settings: Mapping[str, Any] = getattr(source, "kwargs", {})
    if "kd" in settings:
        red, green, blue = (float(each) / 255 for each in source.diffuse[:3])
        return Material((red, green, blue, 1.0), name=name)
    return Material(name=name, is_default=True)


def _texels(image: Any) -> UInt8 | None:
    """Return a Pillow image as RGBA texels (rows, columns, 4); None if it has more than `MOST_TEXELS`."""
    if image is None or image.size[0] * image.size[1] > MOST_TEXELS:
        return None
    return as_texels(image)
