"""Materials in USD: UsdPreviewSurface, and the textures that it names."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from dfd.common.linear_algebra import Float32, Int32, UInt8
from dfd.export.usd.surfaces import BASE, Picture, Surface, Surfaces
from dfd.mesh.appearance import Appearance, Material, linear
from dfd.mesh.file.images import as_png
from dfd.mesh.mesh import MeshPart

_TYPES = {
    "r": Sdf.ValueTypeNames.Float,
    "g": Sdf.ValueTypeNames.Float,
    "b": Sdf.ValueTypeNames.Float,
    "a": Sdf.ValueTypeNames.Float,
    "rgb": Sdf.ValueTypeNames.Float3,
}

Four = tuple[float, float, float, float]


class TextureFiles:
    """PNG files beside a USD file, one for each texture: `files` has their content, by their names."""

    def __init__(self, stem: str) -> None:
        self.files: dict[str, bytes] = {}
        self._stem = stem
        self._names: dict[tuple[int, bool], str] = {}
        self._kept: list[UInt8] = []  # kept alive, since arrays are recognized by their ids

    def name(self, texels: UInt8, *, opaque: bool = False) -> str:
        """The path, from the USD file, of a texture (rows, columns, 4), with its fourth channel unless `opaque`."""
        opaque = opaque or bool((texels[..., 3] == 255).all())
        key = (id(texels), opaque)
        if key not in self._names:
            self._names[key] = f"{self._stem}_texture_{len(self._names)}.png"
            self._kept.append(texels)
            self.files[self._names[key]] = as_png(texels, opaque=opaque)
        return f"./{self._names[key]}"


def add_materials(
    stage: Usd.Stage, scope: str, appearance: Appearance, surfaces: Surfaces, files: TextureFiles
) -> list[Any]:
    """Define a UsdPreviewSurface for each material, and have `files` keep its textures."""
    UsdGeom.Scope.Define(stage, scope)
    # vertex colors apply only where there is no texture: USD does not multiply the two
    has_colors = appearance.colors is not None
    return [
        _Preview(stage, f"{scope}/material_{number}", files).of(
            material, surface, painted=has_colors and material.texture is None
        )
        for number, (material, surface) in enumerate(zip(appearance.materials, surfaces.of_material, strict=True))
    ]


def bind_materials(
    mesh: UsdGeom.Mesh, part: MeshPart, appearance: Appearance, surfaces: Surfaces, materials: list[Any]
) -> None:
    """Give a part texture coordinates and colors at its corners, and each of its faces its material."""
    rows = appearance.corner_faces[part.faces].ravel()
    of_face = appearance.face_material[part.faces]
    used = [int(each) for each in np.unique(of_face)]
    coordinates = {picture.coordinates for each in used for picture in surfaces.of_material[each].pictures}
    if appearance.uv is not None:
        _add_coordinates(mesh, BASE, appearance.uv[rows])
    for name in sorted(coordinates - {BASE}):
        _add_coordinates(mesh, name, surfaces.coordinates[name][rows])
    if appearance.colors is not None:
        _add_colors(mesh, appearance, rows, np.repeat(of_face, 3))
    mesh.CreateDoubleSidedAttr(any(surfaces.of_material[each].double_sided for each in used))
    binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    if len(used) == 1:
        binding.Bind(materials[used[0]])
        return
    for number in used:
        faces = np.flatnonzero(of_face == number).astype(np.int32)
        subset = binding.CreateMaterialBindSubset(f"material_{number}", Vt.IntArray.FromNumpy(faces))
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(materials[number])
    binding.SetMaterialBindSubsetsFamilyType(UsdGeom.Tokens.partition)


def _add_coordinates(mesh: UsdGeom.Mesh, name: str, coordinates: Float32) -> None:
    primvars = UsdGeom.PrimvarsAPI(mesh)
    st = primvars.CreatePrimvar(name, Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(coordinates, np.float32)))


def _add_colors(mesh: UsdGeom.Mesh, appearance: Appearance, rows: Int32, material: Int32) -> None:
    """Vertex colors times those of their materials, as corners show them."""
    assert appearance.colors is not None
    factors = np.array([_linear(each) for each in appearance.materials])[material]
    colors = appearance.colors[rows]
    shown = linear(colors[:, :3]) * factors[:, :3]
    displayed = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.faceVarying)
    displayed.Set(Vt.Vec3fArray.FromNumpy(shown.astype(np.float32)))
    clear = np.array([each.alpha_mode != "OPAQUE" for each in appearance.materials])[material]
    if clear.any():
        opacity = np.where(clear, colors[:, 3] * factors[:, 3], 1.0).astype(np.float32)
        mesh.CreateDisplayOpacityPrimvar(UsdGeom.Tokens.faceVarying).Set(Vt.FloatArray.FromNumpy(opacity))


class _Preview:
    """One UsdPreviewSurface, and the shaders that feed it."""

    def __init__(self, stage: Usd.Stage, path: str, files: TextureFiles) -> None:
        self._stage, self._path, self._files = stage, path, files
        self._material = UsdShade.Material.Define(stage, path)
        self._surface = self._shader("surface", "UsdPreviewSurface")
        self._readers: dict[str, Any] = {}

    def of(self, material: Material, surface: Surface, *, painted: bool) -> Any:
        """Give it the values of a material; `painted` takes the color of the mesh's vertices."""
        self._color(material, painted)
        rough = surface.metallic_roughness
        if rough is None:
            self._set("metallic", surface.metallic)
            self._set("roughness", surface.roughness)
        else:
            scale = (1.0, surface.roughness, surface.metallic, 1.0)
            node = self._texture("metallic_roughness", rough, scale=scale)
            self._connect("metallic", node, "b")
            self._connect("roughness", node, "g")
        if surface.glow is not None:
            self._connect("emissiveColor", self._texture("glow", surface.glow, "sRGB", (*surface.emissive, 1.0)), "rgb")
        elif any(surface.emissive):
            self._set("emissiveColor", Gf.Vec3f(*surface.emissive))
        if surface.normal is not None:
            # from [0, 1] to [−1, 1], as USD requires for 8-bit textures
            spread: tuple[Four, Four] = ((2.0, 2.0, 2.0, 1.0), (-1.0, -1.0, -1.0, 0.0))
            self._connect("normal", self._texture("normal", surface.normal, "raw", *spread), "rgb")
        if surface.occlusion is not None:
            part = surface.occlusion_strength
            rest = 1.0 - part
            node = self._texture(
                "occlusion", surface.occlusion, "raw", (part, part, part, 1.0), (rest, rest, rest, 0.0)
            )
            self._connect("occlusion", node, "r")
        self._material.CreateSurfaceOutput().ConnectToSource(self._surface.ConnectableAPI(), "surface")
        return self._material

    def _color(self, material: Material, painted: bool) -> None:
        factor = _linear(material)
        clear = material.alpha_mode != "OPAQUE"
        if material.alpha_mode == "MASK":
            self._set("opacityThreshold", material.alpha_cutoff)
        if material.texture is not None:
            base = Picture(material.texture, material.wrap, BASE)
            node = self._texture("texture", base, "sRGB", factor, opaque=False)
            self._connect("diffuseColor", node, "rgb")
            if clear:
                self._connect("opacity", node, "a")
        elif painted:
            self._connect("diffuseColor", self._primvar("color", "UsdPrimvarReader_float3", "displayColor"), "result")
            if clear:
                reader = self._primvar("opacity", "UsdPrimvarReader_float", "displayOpacity")
                self._connect("opacity", reader, "result")
        else:
            self._set("diffuseColor", Gf.Vec3f(*factor[:3]))
            if clear:
                self._set("opacity", factor[3])
        if not clear:
            self._set("opacity", 1.0)

    def _texture(
        self,
        name: str,
        picture: Picture,
        space: str = "raw",
        scale: Four = (1.0, 1.0, 1.0, 1.0),
        bias: Four = (0.0, 0.0, 0.0, 0.0),
        *,
        opaque: bool = True,
    ) -> Any:
        file, coordinates = self._files.name(picture.texels, opaque=opaque), picture.coordinates
        texture = self._shader(name, "UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        if coordinates not in self._readers:
            self._readers[coordinates] = self._primvar(coordinates, "UsdPrimvarReader_float2", coordinates)
        uv = self._readers[coordinates].GetOutput("result")
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(uv)
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
        texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
        if any(bias):
            texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))
        for side, each in zip(("wrapS", "wrapT"), picture.wrap, strict=True):
            texture.CreateInput(side, Sdf.ValueTypeNames.Token).Set(each)
        return texture

    def _primvar(self, name: str, kind: str, primvar: str) -> Any:
        types = {"2": Sdf.ValueTypeNames.Float2, "3": Sdf.ValueTypeNames.Float3, "t": Sdf.ValueTypeNames.Float}
        reader = self._shader(name, kind)
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
        reader.CreateOutput("result", types[kind[-1]])
        return reader

    def _shader(self, name: str, kind: str) -> Any:
        shader = UsdShade.Shader.Define(self._stage, f"{self._path}/{name}")
        shader.CreateIdAttr(kind)
        return shader

    def _connect(self, name: str, node: Any, output: str) -> None:
        found = node.GetOutput(output)
        source = found if found else node.CreateOutput(output, _TYPES[output])
        self._input(name).ConnectToSource(source)

    def _set(self, name: str, value: Any) -> None:
        self._input(name).Set(value)

    def _input(self, name: str) -> Any:
        kinds = {"diffuseColor": Sdf.ValueTypeNames.Color3f, "emissiveColor": Sdf.ValueTypeNames.Color3f,
                 "normal": Sdf.ValueTypeNames.Normal3f}  # fmt: skip
        return self._surface.CreateInput(name, kinds.get(name, Sdf.ValueTypeNames.Float))


def _linear(material: Material) -> Four:
    """The factor of the color, which is linear in USD, and of the opacity."""
    red, green, blue = (float(value) for value in linear(np.array(material.color[:3])))
    return red, green, blue, float(material.color[3])
