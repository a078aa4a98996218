"""Rewrite vertex positions and normals in a glTF file, with everything else unchanged.

New positions and normals are appended to the file's data and referenced in its header. Textures, samplers, skins, morph
targets, animations, extras, extensions and parts that did not move are kept bit for bit.
"""

import json
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64
from dfd.mesh.file.assets import image_format
from dfd.mesh.file.edits import far_origin
from dfd.mesh.file.gltf.build import GltfBuilder
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import COMPONENT_TYPES, DRACO, MESHOPT, Header, extension, is_index, objects
from dfd.mesh.file.primitives import Primitive

_UNSIGNED = 5125


def encode(source: GltfData, moved: Sequence[Primitive], *, binary: bool) -> bytes:
    """Return the file `source` with the `moved` primitives, as GLB or as glTF with embedded data.

    External buffers and images are embedded. If such a file cannot be read, the reference to it is kept.
    """
    patch = GltfPatch(source)
    users = Counter(mesh for node in objects(patch.header, "nodes") if isinstance(mesh := node.get("mesh"), int))
    for node, of_node in groupby(moved, lambda each: each.source[0]):
        group = list(of_node)
        if not any(each.moved for each in group):
            continue
        mesh = group[0].source[1]
        own = patch.split_mesh(node, mesh, shared=users[mesh] > 1)
        users[mesh] -= 1
        primitives = patch.header["meshes"][own]["primitives"]
        origin = (
            None if keeps_origin(source, group[0]) else far_origin(np.concatenate([each.vertices for each in group]))
        )
        if origin is not None:
            patch.move_origin(node, origin)
            known = {each.source[2] for each in group}  # all other primitives are points or lines
            for content in (each for number, each in enumerate(primitives) if number not in known):
                positions = source.attribute(content, "POSITION")
                if positions is not None:
                    shifted = (positions - origin).astype("<f4")
                    content["attributes"]["POSITION"] = patch.accessor(shifted, bounds=True)
        for each in group:
            if each.moved or origin is not None:
                patch.move(node, primitives[each.source[2]], each, origin)
    return patch.encode(binary=binary)


def keeps_origin(source: GltfData, each: Primitive) -> bool:
    """Return whether the primitive's node has a skin or morph targets, so that positions must keep their origin."""
    node, mesh, _ = each.source
    primitives = source.header["meshes"][mesh]["primitives"]
    return "skin" in source.header["nodes"][node] or any("targets" in each for each in primitives)


class GltfPatch(GltfBuilder):
    """A copy of a glTF file in which primitives are moved. All data that can be read is in one buffer."""

    def __init__(self, source: GltfData) -> None:
        super().__init__(json.loads(json.dumps(source.header)))
        self.source = source
        self._take_buffers()
        self._take_pictures()
        # Keys: node, attribute and accessor. Values: the new data, and the `attributes` of all primitives that use it.
        self._moved: dict[tuple[int, str, int], tuple[Float64, list[Header]]] = {}

    def _take_buffers(self) -> None:
        """Concatenate the buffers that can be read; all other buffers stay as they are."""
        moved_to: dict[int, tuple[int, int]] = {}  # by a buffer's old index: its new index and first byte
        for index, buffer in enumerate(self.header.get("buffers", [])):
            try:
                moved_to[index] = (0, self._append(self.source.buffer(index)))
            except (ValueError, OSError):  # a fallback buffer of meshopt has no data; a file may be unreadable
                self._unread.append(buffer)
                moved_to[index] = (len(self._unread), 0)
        for view in self.header.get("bufferViews", []):
            for owner in (view, *(found for name in MESHOPT if (found := extension(view, name)) is not None)):
                owner["buffer"], start = moved_to[int(owner["buffer"])]
                if start or "byteOffset" in owner:
                    owner["byteOffset"] = int(owner.get("byteOffset", 0)) + start

    def _take_pictures(self) -> None:
        """Embed the external images that can be read; all other images stay references."""
        for image in self.header.get("images", []):
            uri = image.get("uri")
            if not isinstance(uri, str) or uri.startswith("data:"):
                continue
            try:
                data = self.source.picture(image)
                kind = image_format(data)
            except (ValueError, OSError):  # the reference stays
                continue
            image["bufferView"] = self.view(data)
            del image["uri"]
            image.setdefault("mimeType", f"image/{kind}")

    def split_mesh(self, node: int, mesh: int, *, shared: bool) -> int:
        """Return the index of a node's mesh, after copying the mesh if it is `shared` with other nodes."""
        if shared:
            mesh = self.append("meshes", json.loads(json.dumps(self.source.header["meshes"][mesh])))
            self.header["nodes"][node]["mesh"] = mesh
        return mesh

    def move_origin(self, node: int, origin: Float64) -> None:
        """Move the mesh of a node to a new child node at `origin` (3,)."""
        content = self.header["nodes"][node]
        below: Header = {"mesh": content.pop("mesh"), "translation": origin.tolist()}
        if "name" in content:
            below["name"] = content["name"]
        content.setdefault("children", []).append(self.append("nodes", below))

    def move(self, node: int, primitive: dict[str, Any], each: Primitive, origin: Float64 | None = None) -> None:
        """Give a primitive the normals and positions of `each`. Positions are stored relative to `origin` (3,)."""
        self.unpack(primitive)
        attributes = primitive["attributes"]
        attributes.pop("TANGENT", None)  # old tangents would be wrong after the move; viewers compute missing ones
        geometry = each.geometry
        positions = [geometry.vertices, each.vertices, geometry.stored]
        if origin is not None:
            positions = [None if values is None else values - origin for values in positions]
        self._collect(node, "POSITION", attributes, *positions)  # type: ignore[arg-type]
        if each.normals is not None and geometry.normals is not None and "NORMAL" in attributes:
            self._collect(node, "NORMAL", attributes, geometry.normals, each.normals)

    def unpack(self, primitive: dict[str, Any], *, moving: bool = True) -> None:
        """Decompress a primitive's Draco stream to plain accessors; if `moving`, omit the old positions and normals."""
        packed = self.source.draco(primitive)
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
        """Store `values` as the data of an accessor that has no data."""
        accessor = self.header["accessors"][index]
        component = component or int(accessor["componentType"])
        dtype = np.dtype(COMPONENT_TYPES[component])
        if accessor.get("normalized") and dtype.kind in "iu":
            values = np.rint(values * np.iinfo(dtype).max)
        accessor |= {"componentType": component, "count": len(values)}
        accessor["bufferView"] = self.view(np.ascontiguousarray(values, dtype).tobytes())

    def encode(self, *, binary: bool) -> bytes:
        """Return the file, as GLB or as glTF with embedded data."""
        for (_, name, _), (rows, users) in self._moved.items():
            index = self.accessor(rows.astype("<f4"), bounds=name == "POSITION")
            for attributes in users:
                attributes[name] = index
        self._drop_draco()
        return super().encode(binary=binary)

    def _drop_draco(self) -> None:
        """Remove Draco from the extensions that the header lists, if no primitive uses it."""
        primitives = [each for mesh in objects(self.header, "meshes") for each in objects(mesh, "primitives")]
        if any(extension(each, DRACO) is not None for each in primitives):
            return
        for name in ("extensionsUsed", "extensionsRequired"):
            if DRACO in self.header.get(name, []):
                self.header[name].remove(DRACO)
                if not self.header[name]:  # the format allows no empty lists
                    del self.header[name]

    def _collect(
        self, node: int, name: str, attributes: Header, old: Float64, new: Float64, stored: Float64 | None = None
    ) -> None:
        """Collect the rows of `new` that differ from `old`. Morph targets move the positions `stored` to `old`."""
        key = (node, name, int(attributes[name]))
        rows, users = self._moved.setdefault(key, ((old if stored is None else stored).copy(), []))
        changed = (old != new).any(axis=1)
        rows[changed] = new[changed] if stored is None else new[changed] - old[changed] + stored[changed]
        users.append(attributes)
