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

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64
from dfd.mesh.file.edits import far_origin, rounding
from dfd.mesh.file.gltf.build import GltfBuilder
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import (
    COMPONENT_TYPES,
    DRACO,
    MESHOPT,
    Header,
    animated_nodes,
    drop_attribute,
    drop_extension,
    extension,
    is_index,
    objects,
    parents,
)
from dfd.mesh.file.moved import Saving, moved_gradients, moved_tangents, turned_displacements
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.images import image_format

_UNSIGNED = 5125


def rewrite(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return the source of `saving` with its moved primitives, and the distances by which 32-bit floats move vertices.

    A file in which nothing moves keeps its bytes. In all other files, external buffers and images are embedded; if such
    a file cannot be read, the reference to it is kept.
    """
    target, path, source = saving.target, saving.file.path, saving.file.gltf
    assert path is not None
    assert source is not None
    moved = [*saving.moved, *saving.strands]
    same_kind = target.suffix.lower() == path.suffix.lower()
    in_place = source.is_complete or target.parent.resolve() == path.parent.resolve()
    if same_kind and in_place and not any(each.moved for each in moved):
        return {target.name: source.content.tobytes()}, np.zeros(0)
    kept = [each for each in moved if each.moved and keeps_origin(source, each)]
    lost = np.concatenate([np.zeros(0), *(rounding(each.vertices) for each in kept)])
    patch = GltfPatch(source)
    if any(each.moved and _has_tangents(source.primitive(each)) for each in saving.moved):
        gradients = moved_gradients(saving.vertices, saving.file)
        patch.gradients = {each.source: own for each, own in zip(saving.moved, gradients, strict=True)}
    return {target.name: _encoded(patch, source, moved, binary=target.suffix.lower() == ".glb")}, lost


def _has_tangents(primitive: Header) -> bool:
    return any("TANGENT" in each for each in (primitive["attributes"], *objects(primitive, "targets")))


def _encoded(patch: "GltfPatch", source: GltfData, moved: Sequence[Primitive], *, binary: bool) -> bytes:
    users = Counter(mesh for node in objects(patch.header, "nodes") if isinstance(mesh := node.get("mesh"), int))
    by_node = sorted(moved, key=lambda each: each.source[0])
    for node, of_node in groupby(by_node, lambda each: each.source[0]):
        group = list(of_node)
        if not any(each.moved for each in group):
            continue
        mesh = group[0].source[1]
        own = patch.split_mesh(node, mesh, shared=users[mesh] > 1)
        users[mesh] -= 1
        primitives = patch.header["meshes"][own]["primitives"]
        origin = None
        if group[0].baked:
            if keeps_origin(source, group[0]):
                why = f"must leave part {group[0].part!r:.60} in place, because its skin or its node flattens it"
                raise ArgumentError("vertices", f"{why}, and its file cannot store another shape", "Mesh.save")
            patch.stand_alone(node)
        elif not keeps_origin(source, group[0]):
            origin = far_origin(np.concatenate([each.vertices for each in group]))
        if origin is not None:
            patch.move_origin(node, origin)
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
        super().__init__(json.loads(json.dumps(source.header)), source.chunks)
        self.source = source
        self._take_buffers()
        self._take_pictures()
        # Keys: node, attribute and accessor. Values: the new data, and the `attributes` of all primitives that use it.
        self._moved: dict[tuple[int, str, int], tuple[Float64, list[Header]]] = {}
        self.gradients: dict[tuple[int, int, int], Float64] = {}  # `moved_gradients` of primitives with tangents

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

    def stand_alone(self, node: int) -> int:
        """Make a root node without a transform display the mesh of `node`, and return the index of the root node.

        It is `node` itself, or a new node if children, a camera, an extension or an animation use `node`.
        """
        header = self.header
        content, nodes = header["nodes"][node], objects(header, "nodes")
        if not objects(header, "scenes"):
            below = parents(header)
            header["scenes"] = [{"nodes": [index for index in range(len(nodes)) if index not in below]}]
            header["scene"] = 0
        roots = header["scenes"][header.setdefault("scene", 0)].setdefault("nodes", [])
        if content.get("children") or content.keys() & {"camera", "extensions"} or node in animated_nodes(header):
            named = {"name": content["name"]} if "name" in content else {}
            moved = {name: content.pop(name) for name in ("mesh", "weights") if name in content}
            node = self.append("nodes", moved | named)
        else:
            for name in ("matrix", "translation", "rotation", "scale"):
                content.pop(name, None)
            for parent in nodes:
                if node in parent.get("children", []):
                    parent["children"].remove(node)
                    if not parent["children"]:  # the format allows no empty lists
                        del parent["children"]
        roots += [node] if node not in roots else []
        return node

    def move(self, node: int, primitive: dict[str, Any], each: Primitive, origin: Float64 | None = None) -> None:
        """Give a primitive the normals and positions of `each`. Positions are stored relative to `origin` (3,)."""
        self.unpack(primitive)
        attributes = primitive["attributes"]
        geometry = each.geometry
        positions = [geometry.vertices, each.vertices, geometry.stored]
        if origin is not None:
            positions = [None if values is None else values - origin for values in positions]
        self._collect(node, "POSITION", attributes, *positions)  # type: ignore[arg-type]
        if each.normals is not None and geometry.normals is not None and "NORMAL" in attributes:
            self._collect(node, "NORMAL", attributes, geometry.normals, each.normals)
        if each.source in self.gradients:
            self._turn_tangents(node, primitive, each)

    def _turn_tangents(self, node: int, primitive: Header, each: Primitive) -> None:
        """Turn the tangents of a moved primitive with the surface, and those of its morph targets."""
        gradients, source = self.gradients[each.source], self.source.primitive(each)
        if each.baked:  # positions and normals are now in the scene, but the flattened tangents are lost
            drop_attribute(primitive, "TANGENT")
            check.warn(f"Mesh.save: the tangents of part {each.part!r:.60} are removed", UserWarning)
            return
        old = self.source.attribute(source, "TANGENT")
        if old is not None and old.shape == (len(each.vertices), 4):
            old = old.astype(np.float64)
            new = moved_tangents(old, gradients, each)
            if (new != old).any():
                self._collect(node, "TANGENT", primitive["attributes"], old, new)
        for target in objects(primitive, "targets"):
            moved = self.source.accessor(target["TANGENT"]) if "TANGENT" in target else None
            if moved is not None and moved.shape == each.vertices.shape:
                moved = moved.astype(np.float64)
                turned = turned_displacements(moved, gradients, each)
                if (turned != moved).any():
                    self._collect(node, "TANGENT", target, moved, turned)

    def unpack(self, primitive: dict[str, Any], *, moving: bool = True) -> None:
        """Decompress a primitive's Draco stream to plain accessors; if `moving`, omit the old positions and normals."""
        packed = self.source.draco(primitive)
        if packed is None:
            return
        stored = extension(primitive, DRACO) or {}
        drop_extension(self.header, primitive, DRACO)
        for name in stored.get("attributes", {}):
            if name in packed and not (moving and name in ("POSITION", "NORMAL")):
                self._fill(primitive["attributes"][name], packed[name])
        if not is_index(primitive.get("indices"), len(self.header["accessors"])):
            primitive["indices"] = self.append("accessors", {"type": "SCALAR"})
        primitive["mode"] = 4
        self._fill(primitive["indices"], packed["indices"], _UNSIGNED)

    def place_all(self, index: int) -> None:
        """Give a position to the items of an accessor that lack one: vertices that no face uses."""
        values = self.source.accessor(index)
        if not np.isfinite(values).all():
            self._fill(index, np.where(np.isfinite(values), values, 0))

    def _fill(self, index: int, values: NDArray[Any], component: int | None = None) -> None:
        """Store `values` as the data of an accessor."""
        accessor = self.header["accessors"][index]
        component = component or int(accessor["componentType"])
        dtype = np.dtype(COMPONENT_TYPES[component])
        if accessor.get("normalized") and dtype.kind in "iu":
            values = np.rint(values * np.iinfo(dtype).max)
        for name in ("byteOffset", "sparse"):
            accessor.pop(name, None)
        accessor |= {"componentType": component, "count": len(values)}
        accessor["bufferView"] = self.view(np.ascontiguousarray(values, dtype).tobytes())

    def encode(self, *, binary: bool) -> bytes:
        """Return the file, as GLB or as glTF with embedded data."""
        for (_, name, old), (rows, users) in self._moved.items():
            self.place_all(old)
            stored = np.where(np.isfinite(rows), rows, 0).astype("<f4")
            index = self.accessor(stored, attribute=True, bounds=name == "POSITION")
            for attributes in users:
                attributes[name] = index
        return super().encode(binary=binary)

    def _collect(
        self, node: int, name: str, attributes: Header, old: Float64, new: Float64, stored: Float64 | None = None
    ) -> None:
        """Collect the rows of `new` that differ from `old`. Morph targets move the positions `stored` to `old`."""
        key = (node, name, int(attributes[name]))
        rows, users = self._moved.setdefault(key, ((old if stored is None else stored).copy(), []))
        changed = (old != new).any(axis=1)
        rows[changed] = new[changed] if stored is None else new[changed] - old[changed] + stored[changed]
        users.append(attributes)
