"""What surfaces look like in USD: UsdPreviewSurface with the base color, and the pictures that it names."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from dfd.mesh.appearance import Appearance, Material, linear

if TYPE_CHECKING:
    from dfd.mesh.mesh import MeshPart

__all__ = ["add_looks", "add_materials", "pictures"]

_WRAPS = {"repeat": "repeat", "mirror": "mirror", "clamp": "clamp"}


def pictures(appearance: Appearance | None, stem: str) -> dict[int, tuple[str, bytes]]:
    """The name and the PNG file of the texture of each material that has one."""
    found: dict[int, tuple[str, bytes]] = {}
    of_texture: dict[int, tuple[str, bytes]] = {}
    for number, material in enumerate(appearance.materials if appearance is not None else ()):
        if material.texture is None:
            continue
        if id(material.texture) not in of_texture:
            stream = io.BytesIO()
            opaque = bool((material.texture[..., 3] == 255).all())
            image = Image.fromarray(material.texture[..., :3] if opaque else material.texture)
            image.save(stream, "PNG")
            of_texture[id(material.texture)] = (f"{stem}_texture_{len(of_texture)}.png", stream.getvalue())
        found[number] = of_texture[id(material.texture)]
    return found


def add_materials(stage: Usd.Stage, scope: str, appearance: Appearance, files: dict[int, str]) -> list[Any]:
    """Define a UsdPreviewSurface for each material; `files` names the picture of each that has one."""
    UsdGeom.Scope.Define(stage, scope)
    return [
        _material(stage, f"{scope}/material_{number}", material, files.get(number))
        for number, material in enumerate(appearance.materials)
    ]


def add_looks(mesh: UsdGeom.Mesh, part: MeshPart, appearance: Appearance, materials: list[Any]) -> None:
    """Give a part texture coordinates and colors at its corners, and each of its faces its material."""
    rows = appearance.corner_faces[part.faces].ravel()
    primvars = UsdGeom.PrimvarsAPI(mesh)
    if appearance.uv is not None:
        st = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
        st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(appearance.uv[rows], np.float32)))
    if appearance.colors is not None:
        color = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.faceVarying)
        color.Set(Vt.Vec3fArray.FromNumpy(linear(appearance.colors[rows, :3]).astype(np.float32)))
    of_face = appearance.face_material[part.faces]
    used = np.unique(of_face)
    if appearance.colors is not None and all(appearance.materials[int(each)].texture is None for each in used):
        return  # a material would hide the colors
    if len(used) == 1:
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(materials[int(used[0])])
        return
    binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    for number in used:
        faces = np.flatnonzero(of_face == number).astype(np.int32)
        subset = binding.CreateMaterialBindSubset(f"material_{number}", Vt.IntArray.FromNumpy(faces))
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(materials[int(number)])
    binding.SetMaterialBindSubsetsFamilyType(UsdGeom.Tokens.partition)


def _material(stage: Usd.Stage, path: str, look: Material, file: str | None) -> Any:
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.8)
    surface.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    opacity = surface.CreateInput("opacity", Sdf.ValueTypeNames.Float)
    factor = _linear(look)
    clear = look.alpha_mode != "OPAQUE"
    if look.alpha_mode == "MASK":
        surface.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(look.alpha_cutoff)
    if file is None:
        color.Set(Gf.Vec3f(*factor[:3]))
        opacity.Set(factor[3] if clear else 1.0)
    else:
        texture = _texture(stage, path, look, file, factor)
        color.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
        if clear:
            opacity.ConnectToSource(texture.CreateOutput("a", Sdf.ValueTypeNames.Float))
        else:
            opacity.Set(1.0)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material


def _texture(stage: Usd.Stage, path: str, look: Material, file: str, factor: list[float]) -> Any:
    reader = UsdShade.Shader.Define(stage, f"{path}/st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture = UsdShade.Shader.Define(stage, f"{path}/texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    coordinates = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*factor))
    for name, wrap in zip(("wrapS", "wrapT"), look.wrap, strict=True):
        texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set(_WRAPS[wrap])
    return texture


def _linear(look: Material) -> list[float]:
    """The factor of the color, which is linear in USD, and of the opacity."""
    encoded: NDArray[np.float64] = np.array(look.color[:3])
    return [*(float(value) for value in linear(encoded)), float(look.color[3])]
