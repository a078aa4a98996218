"""Build glTF files: the objects of the JSON header, the data of one buffer, and whole scenes."""

import base64
import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.common.linear_algebra import Float64, Int64, UInt8, unit
from dfd.mesh.appearance import Material, Wrap
from dfd.mesh.colors import linear
from dfd.mesh.file.complete import all_completed
from dfd.mesh.file.edits import COARSE, far_origin
from dfd.mesh.file.gltf.header import COMPONENT_TYPES, Header, join_glb
from dfd.mesh.file.gltf.materials import WRAPS
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.primitives import IDENTITY, Geometry, Primitive
from dfd.mesh.file.text import UniqueNames
from dfd.mesh.images import as_png

FLOAT, _ARRAY_BUFFER = 5126, 34962
LIMITS = {"min": np.min, "max": np.max}
_KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
_WRAPS = {name: number for number, name in WRAPS.items()}
_PLAIN = Material()
_MOST_NAMED = 5  # largest number of attributes that a warning lists
_TRANSFORM = "KHR_texture_transform"
_NUMBERS = {np.dtype(kind): number for number, kind in COMPONENT_TYPES.items()}


class GltfBuilder:
    """A glTF file that is being built: its JSON header, and the data of its first buffer."""

    def __init__(self, header: Header, chunks: Mapping[int, bytes] = MappingProxyType({})) -> None:
        self.header = header
        self._chunks = chunks  # further chunks of a GLB file, by their kinds
        self._data = bytearray()
        self._unread: list[Header] = []  # header entries of buffers that cannot be read; the new file keeps them

    def accessor(
        self, values: NDArray[Any], *, attribute: bool = False, bounds: bool = False, normalized: bool = False
    ) -> int:
        """Append an array with one element in each row, and return the index of its accessor.

        `attribute` marks the data as a vertex attribute. `bounds` stores the minimum and maximum of each component.
        """
        kind = _KINDS[values.shape[1:]]
        stored = np.ascontiguousarray(values.swapaxes(1, 2) if kind == "MAT4" else values)
        view = self.view(stored.tobytes())
        accessor = {"bufferView": view, "componentType": _NUMBERS[stored.dtype], "count": len(stored), "type": kind}
        if attribute:
            self.header["bufferViews"][view]["target"] = _ARRAY_BUFFER
        if normalized:
            accessor["normalized"] = True
        if bounds:
            accessor |= {name: np.atleast_1d(limit(stored, axis=0)).tolist() for name, limit in LIMITS.items()}
        return self.append("accessors", accessor)

    def append(self, name: str, content: Header) -> int:
        """Append an object to the list `name` of the header, and return its index."""
        values: list[Header] = self.header.setdefault(name, [])
        values.append(content)
        return len(values) - 1

    def view(self, data: bytes) -> int:
        """Append data to the buffer, and return the index of its buffer view."""
        return self.append("bufferViews", {"buffer": 0, "byteOffset": self._append(data), "byteLength": len(data)})

    def encode(self, *, binary: bool) -> bytes:
        """Return the file, as GLB or as glTF with embedded data."""
        buffer: Header = {"byteLength": len(self._data)}
        self.header["buffers"] = [buffer, *self._unread]
        if not binary:
            buffer["uri"] = f"data:application/octet-stream;base64,{base64.b64encode(self._data).decode()}"
        text = json.dumps(self.header, separators=(",", ":")).encode()
        return join_glb(text, bytes(self._data), self._chunks) if binary else text

    def _append(self, data: bytes | UInt8) -> int:
        start = len(self._data)
        self._data += data if isinstance(data, bytes) else data.data
        self._data += bytes(-len(data) % 4)
        return start


def encode(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return a GLB or glTF file of a mesh that was not read from such a file."""
    data, _ = encode_complete(saving, binary=saving.target.suffix.lower() == ".glb")
    return {saving.target.name: data}, np.zeros(0)


def encode_complete(saving: Saving, *, binary: bool) -> tuple[bytes, Int64]:
    """Return a file in which all vertices have normals, and the mesh vertex (R,) of each of its rows.

    Viewers use flat shading for primitives without normals.
    """
    complete, vertex = all_completed(saving)
    return _encode_scene(complete, binary=binary), vertex


def _encode_scene(moved: Sequence[Primitive], *, binary: bool) -> bytes:
    """Return the file of a scene: a node for each part, with the part's primitives in order.

    Nodes share a mesh if their parts share unmoved geometries. If a part is so far from the origin that 32-bit floats
    are too coarse, its positions are stored relative to its center, and its node has the translation to this center.
    """
    scene = _Scene({"asset": {"version": "2.0", "generator": "dfd"}, "scene": 0, "scenes": [{"nodes": []}]})
    for part, group in groupby(moved, lambda each: each.part):
        scene.add(part, list(group))
    if scene.rounded:
        changed = ", ".join(f"{count} of {name!r:.40}" for name, count in list(scene.rounded.items())[:_MOST_NAMED])
        check.warn(
            f"Mesh.save: glTF files store further attributes as 32-bit floats, which change values ({changed}); "
            ".ply keeps them",
            UserWarning,
        )
    return scene.encode(binary=binary)


class _Scene(GltfBuilder):
    """A glTF file of one scene, to which parts are added."""

    def __init__(self, header: Header) -> None:
        super().__init__(header)
        self.rounded: dict[str, int] = {}  # by further attribute: the number of values that 32-bit floats change
        self._meshes: dict[tuple[int, ...], tuple[int, NDArray[Any] | None]] = {}
        self._materials: dict[tuple[int, bool, bool], int] = {}
        self._textures: dict[tuple[int, tuple[Wrap, Wrap]], int] = {}

    def add(self, part: str, group: Sequence[Primitive]) -> None:
        """Add a part, whose primitives share one transform."""
        moved = any(each.moved for each in group)
        key = tuple(id(each if moved else each.geometry) for each in group)
        if key not in self._meshes:
            origin = far_origin(np.concatenate([each.vertices for each in group]))
            primitives = [self._primitive(each, origin) for each in group]
            self._meshes[key] = self.append("meshes", {"name": group[0].name, "primitives": primitives}), origin
        mesh, origin = self._meshes[key]
        node: Header = {"name": part, "mesh": mesh}
        transform = group[0].transform
        if origin is not None:
            transform = transform.copy()
            transform[:3, 3] += transform[:3, :3] @ origin
        if transform is not IDENTITY:
            node["matrix"] = transform.T.ravel().tolist()
        self.header["scenes"][0]["nodes"].append(self.append("nodes", node))

    def _primitive(self, each: Primitive, origin: NDArray[Any] | None) -> Header:
        geometry = each.geometry
        colors = geometry.colors
        values: dict[str, NDArray[Any]] = {"POSITION": each.vertices if origin is None else each.vertices - origin}
        if each.normals is not None:
            values["NORMAL"] = unit(each.normals)
        if geometry.uv is not None:
            values["TEXCOORD_0"] = geometry.uv * (1, -1) + (0, 1)  # v points down in glTF
        values |= self._further(geometry)
        attributes = {
            name: self.accessor(own.astype("<f4"), attribute=True, bounds=name == "POSITION")
            for name, own in values.items()
        }
        if colors is not None:
            stored = np.column_stack([linear(colors[:, :3]), colors[:, 3]])
            attributes["COLOR_0"] = self.accessor(
                np.rint(stored * 65535).astype("<u2"), attribute=True, normalized=True
            )
        content: Header = {"attributes": attributes, "indices": self.accessor(geometry.faces.astype("<u4").ravel())}
        material = geometry.material
        if material is None and geometry.uv is not None and colors is None:
            material = _PLAIN  # readers ignore texture coordinates without a material
        if material is not None:
            content["material"] = self._material(material, geometry.uv is not None, colors is not None)
        return content

    def _further(self, geometry: Geometry) -> dict[str, NDArray[Any]]:
        """Return the further attributes of a geometry by their names in glTF, and note those that 32 bits change.

        The format allows no 32-bit integers as attributes.
        """
        found: dict[str, NDArray[Any]] = {}
        names = UniqueNames(2)
        for name, own in geometry.attributes.items():
            if own.ndim > 2 or own.shape[1:] not in _KINDS or own.dtype.kind not in "iuf":
                continue
            finite = np.isfinite(own)
            with np.errstate(over="ignore"):
                stored = np.where(finite, own, 0).astype("<f4")
            stored = np.where(np.isfinite(stored), stored, 0)
            lost = np.abs(np.where(finite, own, 0).astype(np.float64) - stored)
            least = 0.0 if own.dtype.kind in "iu" else COARSE * float(np.ptp(own[finite])) if finite.any() else 0.0
            changed = ~finite | (lost > least)
            if changed.any():
                self.rounded[name] = self.rounded.get(name, 0) + int(changed.sum())
            found[names.unique(f"_{name.lstrip('_').upper()}")] = stored
        return found

    def _material(self, own: Material, textured: bool, colored: bool) -> int:
        key = (id(own), textured, colored)
        if key not in self._materials:
            material = own.shown(has_colors=colored)
            factor = [*linear(np.array(material.color[:3])).tolist(), material.color[3]]
            surface: Header = {"baseColorFactor": factor, "metallicFactor": 0.0, "roughnessFactor": 1.0}
            if material.texture is not None and textured:
                surface["baseColorTexture"] = {
                    "index": self._texture(material.texture, material.wrap),
                    **self._placement(material.placement),
                }
            content: Header = {"name": material.name, "pbrMetallicRoughness": surface}
            if material.alpha_mode != "OPAQUE":
                content["alphaMode"] = material.alpha_mode
            if material.alpha_mode == "MASK":
                content["alphaCutoff"] = material.alpha_cutoff
            self._materials[key] = self.append("materials", content)
        return self._materials[key]

    def _placement(self, placement: tuple[float, float, float, float]) -> Header:
        """Return the extension of a texture reference that scales and shifts texture coordinates; v points down."""
        if placement == _PLAIN.placement:
            return {}
        if _TRANSFORM not in self.header.setdefault("extensionsUsed", []):
            self.header["extensionsUsed"].append(_TRANSFORM)
        scale_u, scale_v, offset_u, offset_v = placement
        change = {"scale": [scale_u, scale_v], "offset": [offset_u, 1 - offset_v - scale_v]}
        return {"extensions": {_TRANSFORM: change}}

    def _texture(self, texels: UInt8, wrap: tuple[Wrap, Wrap]) -> int:
        key = (id(texels), wrap)
        if key not in self._textures:
            image = self.append("images", {"bufferView": self.view(as_png(texels)), "mimeType": "image/png"})
            across, down = (_WRAPS[each] for each in wrap)
            sampler = self.append("samplers", {"wrapS": across, "wrapT": down})
            self._textures[key] = self.append("textures", {"source": image, "sampler": sampler})
        return self._textures[key]
