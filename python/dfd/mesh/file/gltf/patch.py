"""Rewriting vertex positions in a glTF file, with everything else unchanged.

New positions and normals are appended to the file's data and referenced in its header. Textures, samplers, skins, morph
targets, animations, extras, extensions and parts that did not move are kept bit for bit.
"""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64, UInt8
from dfd.mesh.file.gltf import glb
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import COMPONENT_TYPES, DRACO, MESHOPT, Header, extension, is_index, objects
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.primitives import MovedPrimitive

FLOAT, _UNSIGNED, _ARRAY_BUFFER = 5126, 5125, 34962
LIMITS = {"min": np.min, "max": np.max}
_KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
_NUMBERS = {np.dtype(kind): number for number, kind in COMPONENT_TYPES.items()}


@dataclass(frozen=True)
class GltfSource:
    """The header of a glTF file, as text and parsed, and its data."""

    text: bytes
    header: Header
    data: GltfData


def encode(source: GltfSource, moved: Sequence[MovedPrimitive], *, binary: bool) -> bytes:
    """Return the file with its primitives moved, as GLB or as glTF with embedded data.

    External buffers and images are embedded where a displayed mesh, skin, animation or material needs them; other
    external references are kept.
    """
    patch = GltfPatch(source)
    users = Counter(each for node in objects(patch.header, "nodes") for each in _numbers([node.get("mesh")]))
    meshes: dict[int, int] = {}  # from a node with moved parts to its own copy of the mesh
    for each in moved:
        if not each.moved:
            continue
        node, mesh, primitive = each.primitive.source
        if node not in meshes:
            meshes[node] = patch.split_mesh(node, mesh, shared=users[mesh] > 1)
            users[mesh] -= 1
        patch.move(node, patch.header["meshes"][meshes[node]]["primitives"][primitive], each)
    return patch.encode(binary=binary)


class GltfPatch:
    """A copy of the header, all data in one buffer, and pending additions."""

    def __init__(self, source: GltfSource) -> None:
        self.header: Header = json.loads(source.text.decode())
        self._source = source
        self._data = bytearray()
        self._left: list[Header] = []  # external buffers that are kept, after the first
        self._take_buffers()
        self._take_pictures()
        # primitives may share an accessor: rows that one of them moves are moved for all of the node's
        self._rows: dict[tuple[int, str, int], Float64] = {}
        self._uses: dict[tuple[int, str, int], list[dict[str, Any]]] = {}

    def _take_buffers(self) -> None:
        """Concatenate the buffers that are embedded or that displayed content needs."""
        needed = _needed_buffers(self.header)
        moved_to: dict[int, tuple[int, int]] = {}  # from a buffer to its new number and where it starts there
        for index, buffer in enumerate(self.header.get("buffers", [])):
            uri = buffer.get("uri")
            inside = uri is None or uri.startswith("data:")
            try:
                data = self._source.data.buffer(index) if inside or index in needed else None
            except (ValueError, OSError):  # a placeholder of a compressed view, or a file deleted since loading
                data = None
            if data is None:
                self._left.append(buffer)
                moved_to[index] = (len(self._left), 0)
            else:
                moved_to[index] = (0, self._append(data))
        for view in self.header.get("bufferViews", []):
            for owner in (view, *(found for name in MESHOPT if (found := extension(view, name)) is not None)):
                owner["buffer"], start = moved_to[int(owner["buffer"])]
                if start or "byteOffset" in owner:
                    owner["byteOffset"] = int(owner.get("byteOffset", 0)) + start

    def _take_pictures(self) -> None:
        pictures = ImageCache()
        for index in sorted(_needed_images(self.header)):
            image = self.header["images"][index]
            uri = image.get("uri")
            if not isinstance(uri, str) or uri.startswith("data:"):
                continue
            try:
                data = self._source.data.picture(image)
                kind = pictures.open(data).format
            except (ValueError, OSError):  # keep the reference
                continue
            image["bufferView"] = self.view(data)
            del image["uri"]
            image.setdefault("mimeType", f"image/{(kind or 'png').lower()}")

    def split_mesh(self, node: int, mesh: int, *, shared: bool) -> int:
        """Return the mesh of a node, copied where other nodes use the same one."""
        if shared:
            mesh = self.append("meshes", json.loads(json.dumps(self._source.header["meshes"][mesh])))
            self.header["nodes"][node]["mesh"] = mesh
        return mesh

    def move(self, node: int, primitive: dict[str, Any], each: MovedPrimitive) -> None:
        """Replace the positions and normals of a primitive of a node."""
        self.unpack(primitive)
        attributes = primitive["attributes"]
        attributes.pop("TANGENT", None)  # invalid on the moved surface; viewers recompute them
        geometry = each.primitive.geometry
        self._collect(node, "POSITION", attributes, geometry.vertices, each.vertices, geometry.stored)
        if each.normals is not None and geometry.normals is not None and "NORMAL" in attributes:
            self._collect(node, "NORMAL", attributes, geometry.normals, each.normals)

    def unpack(self, primitive: dict[str, Any], *, moving: bool = True) -> None:
        """Decompress a primitive's Draco stream into plain accessors.

        Positions and normals that are `moving` are left out: the stream holds the old ones.
        """
        packed = self._source.data.draco(primitive)
        if packed is None:
            return
        stored = extension(primitive, DRACO) or {}
        primitive["extensions"].pop(DRACO)
        for name in stored.get("attributes", {}):
            if name in packed and not (moving and name in ("POSITION", "NORMAL")):
                self._fill(primitive["attributes"][name], packed[name])
        if not is_index(primitive.get("indices"), len(self.header["accessors"])):
            primitive["indices"] = self.append("accessors", {"type": "SCALAR"})
        primitive["mode"] = 4
        self._fill(primitive["indices"], packed["indices"], _UNSIGNED)

    def _fill(self, index: int, values: NDArray[Any], component: int | None = None) -> None:
        """Give an accessor without data its data."""
        accessor = self.header["accessors"][index]
        component = component or int(accessor["componentType"])
        dtype = np.dtype(COMPONENT_TYPES[component])
        if accessor.get("normalized") and dtype.kind in "iu":
            values = np.rint(values * np.iinfo(dtype).max)
        accessor |= {"componentType": component, "count": len(values)}
        accessor["bufferView"] = self.view(np.ascontiguousarray(values, dtype).tobytes())

    def encode(self, *, binary: bool) -> bytes:
        """Return the file, as GLB or as glTF with embedded data."""
        for key, rows in self._rows.items():
            index = self.accessor(rows.astype("<f4"), bounds=key[1] == "POSITION")
            for attributes in self._uses[key]:
                attributes[key[1]] = index
        self._drop_draco()
        buffer: Header = {"byteLength": len(self._data)}
        self.header["buffers"] = [buffer, *self._left]
        if not binary:
            buffer["uri"] = f"data:application/octet-stream;base64,{base64.b64encode(bytes(self._data)).decode()}"
        text = json.dumps(self.header, separators=(",", ":")).encode()
        return glb.join(text, bytes(self._data)) if binary else text

    def _drop_draco(self) -> None:
        """Name Draco's extension no longer where no primitive uses it any more."""
        for mesh in objects(self.header, "meshes"):
            if any(extension(each, DRACO) is not None for each in objects(mesh, "primitives")):
                return
        for name in ("extensionsUsed", "extensionsRequired"):
            left = [each for each in self.header.get(name, []) if each != DRACO]
            if left != self.header.get(name, left):
                self.header[name] = left
                if not left:  # the format allows no empty lists
                    del self.header[name]

    def accessor(self, values: NDArray[Any], *, attribute: bool = False, bounds: bool = False) -> int:
        """Append an array, one row an element, and return the number of its accessor.

        `attribute` marks vertex attributes; `bounds` stores the smallest and largest values.
        """
        kind = _KINDS[values.shape[1:]]
        stored = np.ascontiguousarray(values.swapaxes(1, 2) if kind == "MAT4" else values)
        view = self.view(stored.tobytes())
        accessor = {"bufferView": view, "componentType": _NUMBERS[stored.dtype], "count": len(stored), "type": kind}
        if attribute:
            self.header["bufferViews"][view]["target"] = _ARRAY_BUFFER
        if bounds:
            accessor |= {name: np.atleast_1d(limit(stored, axis=0)).tolist() for name, limit in LIMITS.items()}
        return self.append("accessors", accessor)

    def append(self, name: str, content: Header) -> int:
        """Append an object to a list of the header and return its number."""
        values: list[Header] = self.header.setdefault(name, [])
        values.append(content)
        return len(values) - 1

    def _collect(
        self,
        node: int,
        name: str,
        attributes: dict[str, Any],
        old: Float64,
        new: Float64,
        stored: Float64 | None = None,  # the file's positions, before morph targets
    ) -> None:
        key = (node, name, int(attributes[name]))
        rows = self._rows.setdefault(key, (old if stored is None else stored).copy())
        changed = (old != new).any(axis=1)
        rows[changed] = new[changed] if stored is None else new[changed] - old[changed] + stored[changed]
        self._uses.setdefault(key, []).append(attributes)

    def view(self, data: bytes) -> int:
        return self.append("bufferViews", {"buffer": 0, "byteOffset": self._append(data), "byteLength": len(data)})

    def _append(self, data: bytes | UInt8) -> int:
        start = len(self._data)
        self._data += data if isinstance(data, bytes) else data.data
        self._data += bytes(-len(data) % 4)
        return start


def _needed_buffers(header: Header) -> set[int]:
    """Return the buffers that meshes of the scene's nodes, skins, animations and shown pictures take data from."""
    accessors = _numbers([skin.get("inverseBindMatrices") for skin in objects(header, "skins")])
    views: set[int] = set()
    for primitive in _shown_primitives(header):
        targets = primitive.get("targets")
        for each in (primitive.get("attributes"), *(targets if isinstance(targets, list) else [])):
            accessors |= _numbers(each)
        accessors |= _numbers([primitive.get("indices")])
        views |= _numbers([(extension(primitive, DRACO) or {}).get("bufferView")])
    for animation in objects(header, "animations"):
        for sampler in objects(animation, "samplers"):
            accessors |= _numbers([sampler.get("input"), sampler.get("output")])
    for accessor in _named(header, "accessors", accessors):
        sparse = accessor.get("sparse")
        parts = [sparse.get(name) for name in ("indices", "values")] if isinstance(sparse, dict) else []
        views |= _numbers([each.get("bufferView") for each in (accessor, *parts) if isinstance(each, dict)])
    views |= _numbers([header["images"][index].get("bufferView") for index in _needed_images(header)])
    buffers: set[int] = set()
    for view in _named(header, "bufferViews", views):
        packed = [found for name in MESHOPT if (found := extension(view, name)) is not None]
        buffers.update(int(each["buffer"]) for each in (view, *packed))
    return buffers


def _needed_images(header: Header) -> set[int]:
    """Return the pictures of the textures of the materials of the primitives that are shown."""
    used = _numbers([primitive.get("material") for primitive in _shown_primitives(header)])
    textures: set[int] = set()
    for material in _named(header, "materials", used):
        textures |= _texture_indices(material)
    found: set[int] = set()
    for texture in _named(header, "textures", textures):
        others = texture.get("extensions")
        owners = (texture, *(others.values() if isinstance(others, dict) else ()))
        found |= _numbers([each.get("source") for each in owners if isinstance(each, dict)])
    return {each for each in found if is_index(each, len(objects(header, "images")))}


def _texture_indices(material: Header) -> set[int]:
    """Return the textures that a material names, in the format itself or in an extension."""
    found: set[int] = set()
    layer: list[Any] = [material]
    while layer:
        value = layer.pop()
        for name, inner in value.items() if isinstance(value, dict) else [("", each) for each in value]:
            if isinstance(inner, dict | list) and name != "extras":
                layer.append(inner)
                if name.lower().endswith("texture") and isinstance(inner, dict):
                    found |= _numbers([inner.get("index")])
    return found


def _shown_primitives(header: Header) -> list[Header]:
    shown = _numbers([node.get("mesh") for node in objects(header, "nodes")])
    return [each for mesh in _named(header, "meshes", shown) for each in objects(mesh, "primitives")]


def _named(header: Header, name: str, indices: set[int]) -> list[Header]:
    """Return the objects of a list of the header that `indices` name."""
    return [each for index, each in enumerate(objects(header, name)) if index in indices]


def _numbers(values: object) -> set[int]:
    """Return the whole numbers in a list or among the values of an object."""
    inner = values.values() if isinstance(values, dict) else values if isinstance(values, list) else ()
    return {each for each in inner if isinstance(each, int) and not isinstance(each, bool)}
