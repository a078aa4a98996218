"""The materials of a glTF file: base colors, their textures and texture coordinates."""

from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np

from dfd.common.linear_algebra import Float64, UInt8
from dfd.mesh.appearance import Material, Wrap
from dfd.mesh.colors import srgb
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import extension, item
from dfd.mesh.file.text import shortened

WRAPS: dict[int, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat"}

_BLACK = 0.01  # linear value of a base color below which a surface that emits light shows only this light


@dataclass(frozen=True)
class Surface:
    """A material, with the texture coordinates that it uses."""

    material: Material
    uv_set: int = 0  # n of the attribute TEXCOORD_n
    uv_transform: Float64 | None = None  # (2, 3) KHR_texture_transform, for coordinates whose v points down


def read_surface(data: GltfData, index: int) -> Surface:
    """Return the material with the index `index`: its base color, and the texture of the base color."""
    content = data.header["materials"][index]
    found = content.get("pbrMetallicRoughness")
    base = found if isinstance(found, dict) else {}
    factor, reference = base.get("baseColorFactor"), base.get("baseColorTexture")
    # This extension is an older model of materials. It stores a diffuse color in place of the base color.
    glossiness = extension(content, "KHR_materials_pbrSpecularGlossiness")
    if glossiness is not None:
        factor, reference = glossiness.get("diffuseFactor"), glossiness.get("diffuseTexture")
    color = _numbers(factor, 4, 1.0)
    emission = _numbers(content.get("emissiveFactor"), 3, 0.0)
    if max(color[:3]) < _BLACK and max(emission) > 0:  # a black surface shows only the light that it emits
        color, reference = [*emission, color[3]], content.get("emissiveTexture")
    name = str(content.get("name", ""))
    texels, wrap = _texture(data, reference, name)
    if reference is not None and texels is None:
        return Surface(Material(name=name, is_default=True), *_coordinates(reference))
    mode, cutoff = content.get("alphaMode"), content.get("alphaCutoff")
    material = Material(
        (*(float(each) for each in srgb(np.array(color[:3]))), min(max(color[3], 0.0), 1.0)),  # type: ignore[arg-type]
        texels,
        wrap,
        cast(Literal["OPAQUE", "MASK", "BLEND"], mode if mode in ("MASK", "BLEND") else "OPAQUE"),
        float(cutoff) if isinstance(cutoff, int | float) else 0.5,
        name,
    )
    return Surface(material, *_coordinates(reference))


def _texture(data: GltfData, reference: Any, name: str) -> tuple[UInt8 | None, tuple[Wrap, Wrap]]:
    """Return the texels and wrap modes of a texture; the texels are None if they are missing or cannot be read."""
    texture = item(data.header, "textures", reference.get("index")) if isinstance(reference, dict) else None
    failed = unnamed = f"the texture of material {shortened(name)}"
    for owner in () if texture is None else (extension(texture, "EXT_texture_webp") or {}, texture):
        content = item(data.header, "images", owner.get("source"))
        if content is None:
            continue
        try:
            texels = data.assets.texels(data.picture(content))
        except (ValueError, OSError):
            uri = content.get("uri")
            failed = shortened(uri) if isinstance(uri, str) else unnamed
            continue
        sampler = item(data.header, "samplers", (texture or {}).get("sampler")) or {}
        named = (sampler.get("wrapS"), sampler.get("wrapT"))
        across, down = (WRAPS.get(each, "repeat") if isinstance(each, int) else "repeat" for each in named)
        return texels, (across, down)
    if reference is not None:
        data.assets.unreadable.add(failed)
    return None, ("repeat", "repeat")


def _coordinates(reference: Any) -> tuple[int, Float64 | None]:
    """Return n of the attribute TEXCOORD_n of a texture, and its KHR_texture_transform: a matrix (2, 3) or None."""
    if not isinstance(reference, dict):
        return 0, None
    number = reference.get("texCoord", 0)
    change = extension(reference, "KHR_texture_transform")
    matrix = None
    if change is not None:
        number = change.get("texCoord", number)
        offset_u, offset_v = _numbers(change.get("offset"), 2, 0)
        scale_u, scale_v = _numbers(change.get("scale"), 2, 1)
        (angle,) = _numbers([change.get("rotation", 0)], 1, 0)
        cosine, sine = np.cos(angle), np.sin(angle)
        matrix = np.array([[cosine * scale_u, sine * scale_v, offset_u], [-sine * scale_u, cosine * scale_v, offset_v]])
    return number if isinstance(number, int) else 0, matrix


def _numbers(values: Any, count: int, default: float) -> list[float]:
    """Return `values` if they are `count` finite numbers; otherwise return `count` numbers equal to `default`."""
    if isinstance(values, list) and len(values) == count and all(isinstance(each, int | float) for each in values):
        numbers = [float(each) for each in values]
        if np.isfinite(numbers).all():
            return numbers
    return [float(default)] * count
