"""Material properties of a glTF file beyond the base color that UsdPreviewSurface supports.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 3.9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, UInt8
from dfd.mesh.appearance import Wrap
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import Header, extension, item
from dfd.mesh.file.gltf.materials import GltfMaterials, coordinates
from dfd.mesh.file.gltf.read import from_below
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.mesh import Mesh

BASE = "st"  # the primvar with the texture coordinates of the base color


@dataclass(frozen=True, eq=False)
class Picture:
    """A texture."""

    texels: UInt8  # (rows, columns, 4) RGBA, the first row on top
    wrap: tuple[Wrap, Wrap]  # addressing outside [0, 1] along u and v
    coordinates: str  # the primvar with its texture coordinates


@dataclass(frozen=True, eq=False)
class Surface:
    """A material without its base color."""

    # metallic, roughness: in [0, 1]; they multiply the blue and the green of `metallic_roughness`
    metallic: float = 0.0
    roughness: float = 0.8
    # linear red, green and blue of the emitted light; they multiply those of `glow`
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    double_sided: bool = True  # whether it is seen from behind
    # metallic_roughness, normal, occlusion, glow: textures; None where there is none, or it cannot be read
    metallic_roughness: Picture | None = None
    normal: Picture | None = None
    occlusion: Picture | None = None
    occlusion_strength: float = 1.0  # in [0, 1], how much `occlusion` darkens
    glow: Picture | None = None

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """The textures that there are."""
        every = (self.metallic_roughness, self.normal, self.occlusion, self.glow)
        return tuple(each for each in every if each is not None)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The surfaces of a mesh."""

    of_material: tuple[Surface, ...]  # one for each material of the mesh's appearance
    # (R, 2) texture coordinates, v upwards, of the rows of the appearance, by the names of primvars
    coordinates: dict[str, Float32]
    notes: tuple[str, ...]  # sentences about what USD cannot store


def read_surfaces(mesh: Mesh) -> Surfaces:
    """The surfaces of a mesh's glTF file; defaults for other meshes."""
    if mesh.appearance is None:
        return Surfaces((), {}, ())
    count = len(mesh.appearance.materials)
    source = None if mesh.scene is None else mesh.scene.gltf
    if mesh.scene is None or source is None:
        return Surfaces((Surface(),) * count, {}, ())
    reader = _Reader(source.header, source.data, len(mesh.appearance.corners))
    shown: dict[int, list[Primitive]] = {}
    for each in mesh.scene.primitives:
        shown.setdefault(int(mesh.appearance.face_material[each.faces.start]), []).append(each)
    found = [
        reader.surface(shown.get(number, []), material.texture is not None)
        for number, material in enumerate(mesh.appearance.materials)
    ]
    notes = [f"USD does not scale normal textures: {', '.join(reader.scaled)}"] if reader.scaled else []
    notes += [f"could not be read: {', '.join(sorted(reader.unreadable))}"] if reader.unreadable else []
    return Surfaces(tuple(found), reader.coordinates, tuple(notes))


class _Reader:
    """Reads materials, each picture once."""

    def __init__(self, header: Header, data: GltfData, rows: int) -> None:
        self.unreadable: set[str] = set()
        self.scaled: list[str] = []
        self.coordinates: dict[str, Float32] = {}
        self._header, self._data, self._rows = header, data, rows
        self._materials = GltfMaterials(header, data, ImageCache(), self.unreadable)
        self._names: dict[tuple[int, bytes], str] = {}

    def surface(self, primitives: Sequence[Primitive], has_picture: bool) -> Surface:
        """The surface of the material that all of these primitives have."""
        if not primitives:
            return Surface()
        content = item(self._header, "materials", self._primitive(primitives[0]).get("material"))
        if content is None:  # the format's default material
            return Surface(1.0, 1.0, double_sided=False)
        base = _object(content, "pbrMetallicRoughness")
        known = _key(base.get("baseColorTexture")) if has_picture else None
        named = str(content.get("name", ""))

        def picture(owner: Header, name: str) -> Picture | None:
            return self._picture(owner.get(name), named, primitives, known)

        strength = _number(extension(content, "KHR_materials_emissive_strength") or {}, "emissiveStrength", np.inf)
        red, green, blue = _three(content.get("emissiveFactor"))
        normal = picture(content, "normalTexture")
        if normal is not None and _number(content["normalTexture"], "scale", np.inf) != 1.0:
            self.scaled.append(named or "a material without a name")
        sheen = extension(content, "KHR_materials_pbrSpecularGlossiness") is None
        return Surface(
            metallic=_number(base, "metallicFactor") if sheen else 0.0,
            roughness=_number(base, "roughnessFactor") if sheen else 0.8,
            emissive=(strength * red, strength * green, strength * blue),
            double_sided=content.get("doubleSided") is True,
            metallic_roughness=picture(base, "metallicRoughnessTexture"),
            normal=normal,
            occlusion=picture(content, "occlusionTexture"),
            occlusion_strength=_number(_object(content, "occlusionTexture"), "strength"),
            glow=picture(content, "emissiveTexture"),
        )

    def _picture(
        self, reference: Any, named: str, primitives: Sequence[Primitive], known: tuple[int, bytes] | None
    ) -> Picture | None:
        if reference is None:
            return None
        texels, wrap = self._materials.texture(reference, named)
        key = _key(reference)
        found = [self._coordinates(each, reference) for each in primitives]
        if texels is None or all(each is None for each in found):
            return None
        if key == known:
            return Picture(texels, wrap, BASE)
        name = self._names.setdefault(key, f"{BASE}{len(self._names) + 1}")
        rows = self.coordinates.setdefault(name, np.zeros((self._rows, 2), np.float32))
        for each, uv in zip(primitives, found, strict=True):
            if uv is not None:
                rows[each.rows] = np.where(np.isfinite(uv), uv, 0.0).clip(-1e6, 1e6)
        return Picture(texels, wrap, name)

    def _coordinates(self, primitive: Primitive, reference: Any) -> Float64 | None:
        """(rows, 2) texture coordinates of the rows of a primitive; None where the file has none."""
        number, transform = coordinates(reference)
        found = self._data.attribute(self._primitive(primitive), f"TEXCOORD_{number}")
        if found is None or found.shape != (primitive.rows.stop - primitive.rows.start, 2):
            return None
        return from_below(found, transform)

    def _primitive(self, primitive: Primitive) -> Header:
        _, mesh, number = primitive.source
        return self._header["meshes"][mesh]["primitives"][number]


def _key(reference: Any) -> tuple[int, bytes]:
    """The key of a texture's coordinates: equal for textures with the same coordinates and transform."""
    number, transform = coordinates(reference)
    return number, b"" if transform is None else transform.tobytes()


def _object(owner: Header, name: str) -> Header:
    found = owner.get(name)
    return found if isinstance(found, dict) else {}


def _number(owner: Header, name: str, most: float = 1.0) -> float:
    """A factor of a material, 1 where the file has none."""
    value = owner.get(name, 1.0)
    return min(max(float(value), 0.0), most) if isinstance(value, int | float) and np.isfinite(value) else 1.0


def _three(values: Any) -> tuple[float, float, float]:
    if isinstance(values, list) and len(values) == 3:
        red, green, blue = (_number({"value": each}, "value") for each in values)
        return red, green, blue
    return 0.0, 0.0, 0.0
