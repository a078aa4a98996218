"""Moving the vertices of a glTF file and leaving everything else in it alone.

New positions and normals are appended to the file's data and named in its header. Textures, samplers, skins, morph
targets, animations, extras and extensions stay as they are, bit for bit; so do parts that did not move.
"""

from __future__ import annotations

import base64
import copy
import json
import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from dfd.mesh.file import gltf_header
from dfd.mesh.file.parts import MovedPart

__all__ = ["GltfSource", "encode", "places"]

_FLOAT = 5126


@dataclass(frozen=True)
class GltfSource:
    """A glTF file's header and data, and where in it each part stands."""

    header: dict[str, Any]
    buffers: tuple[bytes, ...]
    images: dict[int, bytes]  # pictures that lie in files of their own
    places: tuple[tuple[int, int, int], ...]  # of each part: node, mesh, primitive

    @classmethod
    def of(
        cls, header: dict[str, Any], data: bytes, assets: Any, places: Sequence[tuple[int, int, int]]
    ) -> GltfSource | None:
        """Return the source of a file that trimesh has read, None where data or a picture of it cannot be read."""
        images = {}
        try:
            for index, image in enumerate(header.get("images", [])):
                uri = image.get("uri")
                if isinstance(uri, str) and not uri.startswith("data:"):
                    images[index] = assets.get(uri)
            buffers = tuple(_buffer(buffer, data, assets) for buffer in header.get("buffers", []))
        except Exception:  # a picture may fail in any of Pillow's ways; it has been warned of
            return None
        return cls(header, buffers, images, tuple(places))


def encode(source: GltfSource, moved: Sequence[MovedPart], *, binary: bool) -> bytes:
    """Return the file with its parts moved, as GLB or as glTF with its data inside."""
    patch = _Patch(source)
    users = Counter(node.get("mesh") for node in patch.header.get("nodes", []))
    meshes: dict[int, int] = {}  # from a node whose parts moved to the mesh that is now its own
    for each, (node, mesh, primitive) in zip(moved, source.places, strict=True):
        if not each.moved:
            continue
        if node not in meshes:
            meshes[node] = patch.own_mesh(node, mesh, shared=users[mesh] > 1)
            users[mesh] -= 1
        patch.move(node, patch.header["meshes"][meshes[node]]["primitives"][primitive], each)
    patch.store()
    return patch.glb() if binary else patch.gltf()


class _Patch:
    """A copy of the header, all data in one buffer, and what is still to be appended."""

    def __init__(self, source: GltfSource) -> None:
        self.header = copy.deepcopy(source.header)
        self._data = bytearray()
        starts = [self._append(data) for data in source.buffers]
        for view in self.header.get("bufferViews", []):
            view["byteOffset"] = int(view.get("byteOffset", 0)) + starts[int(view["buffer"])]
            view["buffer"] = 0
        for index, data in source.images.items():
            image = self.header["images"][index]
            image["bufferView"] = self._view(data)
            suffix = image.pop("uri").rsplit(".", 1)[-1].lower()
            image.setdefault("mimeType", f"image/{'jpeg' if suffix == 'jpg' else suffix}")
        # primitives may share an accessor: rows that one of them moves are moved for all of the node's
        self._rows: dict[tuple[int, str, int], NDArray[np.float64]] = {}
        self._uses: dict[tuple[int, str, int], list[dict[str, Any]]] = {}

    def own_mesh(self, node: int, mesh: int, shared: bool) -> int:
        """Return the mesh of a node, a copy of its own where other nodes show the same one."""
        if not shared:
            return mesh
        self.header["meshes"].append(copy.deepcopy(self.header["meshes"][mesh]))
        self.header["nodes"][node]["mesh"] = len(self.header["meshes"]) - 1
        return len(self.header["meshes"]) - 1

    def move(self, node: int, primitive: dict[str, Any], each: MovedPart) -> None:
        attributes = primitive["attributes"]
        attributes.pop("TANGENT", None)  # of the old surface; viewers make new ones
        primitive.get("extensions", {}).pop("KHR_draco_mesh_compression", None)
        self._collect(node, "POSITION", attributes, each.part.geometry.vertices.view(np.ndarray), each.vertices)
        if each.normals is not None and each.file_normals is not None and "NORMAL" in attributes:
            self._collect(node, "NORMAL", attributes, each.file_normals, each.normals)

    def store(self) -> None:
        """Append what was collected to the data and name it in the header."""
        for key, rows in self._rows.items():
            values = rows.astype("<f4")
            accessor: dict[str, Any] = {
                "bufferView": self._view(values.tobytes()),
                "componentType": _FLOAT,
                "count": len(values),
                "type": "VEC3",
            }
            if key[1] == "POSITION":
                accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
            self.header["accessors"].append(accessor)
            for attributes in self._uses[key]:
                attributes[key[1]] = len(self.header["accessors"]) - 1
        self.header["buffers"] = [{"byteLength": len(self._data)}]

    def glb(self) -> bytes:
        text = json.dumps(self.header, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = [struct.pack("<II", len(text), 0x4E4F534A), text]
        chunks += [struct.pack("<II", len(self._data), 0x004E4942), bytes(self._data)]
        return b"".join([struct.pack("<4sII", b"glTF", 2, 12 + sum(map(len, chunks))), *chunks])

    def gltf(self) -> bytes:
        data = base64.b64encode(bytes(self._data)).decode()
        self.header["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
        return json.dumps(self.header, separators=(",", ":")).encode()

    def _collect(
        self, node: int, name: str, attributes: dict[str, Any], old: NDArray[np.float64], new: NDArray[np.float64]
    ) -> None:
        key = (node, name, int(attributes[name]))
        rows = self._rows.setdefault(key, old.copy())
        changed = (old != new).any(axis=1)
        rows[changed] = new[changed]
        self._uses.setdefault(key, []).append(attributes)

    def _view(self, data: bytes) -> int:
        views: list[dict[str, Any]] = self.header.setdefault("bufferViews", [])
        views.append({"buffer": 0, "byteOffset": self._append(data), "byteLength": len(data)})
        return len(views) - 1

    def _append(self, data: bytes) -> int:
        start = len(self._data)
        self._data += data + bytes(-len(data) % 4)
        return start


def _buffer(buffer: dict[str, Any], data: bytes, assets: Any) -> bytes:
    uri = buffer.get("uri")
    if uri is None:  # the second chunk of a GLB file
        start = 20 + struct.unpack("<I", data[12:16])[0]
        length = struct.unpack("<I", data[start : start + 4])[0]
        return data[start + 8 : start + 8 + length]
    if uri.startswith("data:"):
        return base64.b64decode(uri.split("base64,", 1)[1])
    return bytes(assets.get(uri))


def places(header: dict[str, Any], scene: trimesh.Scene) -> dict[str, tuple[int, int, int]] | None:
    """Return node, mesh and primitive behind each of trimesh's nodes, None where its names do not lead to them."""
    found = [
        (mesh, primitive)
        for mesh, each in enumerate(header.get("meshes", []))
        for primitive, content in enumerate(each["primitives"])
        if content.get("mode", 4) in gltf_header.MODES_READ
    ]
    if len(found) != len(scene.geometry):
        return None
    primitive_of = dict(zip(scene.geometry, found, strict=True))
    node_of: dict[str, int] = {}
    counts: dict[str, int] = {}
    for index, node in enumerate(header.get("nodes", [])):  # as trimesh makes them unique
        node_of[trimesh.util.unique_name(node.get("name", str(index)), node_of, counts=counts)] = index
    result = {}
    graph = scene.graph.transforms
    for name in scene.graph.nodes_geometry:
        mesh, primitive = primitive_of[graph.node_data[name]["geometry"]]
        # the primitives of one mesh are children, with names made up, of the node that shows it
        nodes = [node_of[each] for each in (name, graph.parents.get(name)) if each in node_of]
        shows = next((each for each in nodes if header["nodes"][each].get("mesh") == mesh), None)
        if shows is None:
            return None
        result[name] = (shows, mesh, primitive)
    return result if len(set(result.values())) == len(result) else None
