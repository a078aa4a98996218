"""A glTF file to which exporters add content: a copy of the file from which the mesh was read, or a new file.

The format: Khronos Group, "glTF 2.0 Specification", 2021.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.files import write_file
from dfd.common.linear_algebra import Int64
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.gltf import read as gltf_read
from dfd.mesh.file.gltf.build import FLOAT, LIMITS, encode_complete
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import Header, objects
from dfd.mesh.file.gltf.patch import GltfPatch
from dfd.mesh.file.moved import Saving, moved_primitives
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.mesh import Mesh


class GltfDocument(GltfPatch):
    """The JSON header and the data of a glTF file that is being written. Exporters change the header in place."""

    scene: SceneFile  # the displayed primitives; a *row* is a vertex of one primitive, and there are R rows
    vertex: Int64  # (R + L,) mesh vertex of each row; −1 for a row that no face uses

    def __init__(self, mesh: Mesh) -> None:
        """Copy the glTF file from which `mesh` was read, or build a file for a mesh without one."""
        if mesh.scene is not None and mesh.scene.gltf is not None:
            self.scene = mesh.scene
            self.vertex = mesh.scene.vertex.astype(np.int64)
            source = mesh.scene.gltf
        else:
            moved, strands = moved_primitives(mesh.vertices, mesh.scene)
            saving = Saving(Path("mesh.glb"), mesh.vertices, mesh.faces, mesh.appearance, mesh.scene, moved, strands)
            written, self.vertex = encode_complete(saving, binary=True)
            source = GltfData(written, AssetFolder(saving.target))
            self.scene = SceneFile.of(None, gltf_read.read(source), gltf=source)
        super().__init__(source)
        self._own: dict[int, int] = {}
        self._unpacked: set[int] = set()

    def parts(self) -> dict[int, list[Primitive]]:
        """Return the primitives of each node with a displayed mesh, lines and points last."""
        found: dict[int, list[Primitive]] = {}
        for each in (*self.scene.primitives, *self.scene.strands):
            found.setdefault(each.source[0], []).append(each)
        return found

    def vertex_of_positions(self, primitives: Sequence[Primitive]) -> dict[int, Int64]:
        """Return the mesh vertex (N,) of each row of the positions of a node's primitives, by their accessor.

        Primitives can share positions. Vertices of faces then take precedence over those that lines and points follow.
        """
        found: dict[int, Int64] = {}
        contents = self.own_mesh(primitives[0].source[0])["primitives"]
        for each in primitives:
            position, vertex = int(contents[each.source[2]]["attributes"]["POSITION"]), self.vertex[each.rows]
            known = found.get(position, vertex)
            found[position] = np.where(known >= 0, known, vertex)
        return found

    def own_mesh(self, node: int) -> Header:
        """Return a node's mesh in the header. Copy the mesh first if nodes share it, and decompress its vertex data."""
        if node not in self._own:
            nodes = objects(self.header, "nodes")
            mesh = int(nodes[node]["mesh"])
            shared = sum(each.get("mesh") == mesh for each in nodes) > 1
            self._own[node] = self.split_mesh(node, mesh, shared=shared)
        content = objects(self.header, "meshes")[self._own[node]]
        for number, primitive in enumerate(content["primitives"]):
            if id(primitive) not in self._unpacked and "POSITION" in primitive["attributes"]:
                self._unpacked.add(id(primitive))
                self.unpack(primitive, moving=False)
                self._bound(node, number, primitive)
        return content

    def _bound(self, node: int, number: int, primitive: Header) -> None:
        """Add the bounds of positions, which glTF requires, if they are missing or the positions were compressed."""
        index = int(primitive["attributes"]["POSITION"])
        accessor, before = self.header["accessors"][index], self.source.header["accessors"][index]
        packed = "bufferView" not in before
        if not packed:
            self.place_all(index)
        if accessor["componentType"] == FLOAT and (packed or not accessor.keys() >= LIMITS.keys()):
            values = self.values(node, number, "POSITION")
            assert values is not None
            stored = np.where(np.isfinite(values), values, 0).astype("<f4")
            accessor |= {name: limit(stored, axis=0).tolist() for name, limit in LIMITS.items()}

    def values(self, node: int, primitive: int, name: str) -> NDArray[Any] | None:
        """Return an attribute, (rows, components), of a primitive in the original file; None if it is missing."""
        return self.source.attribute(self._primitive(node, primitive), name)

    def corners(self, node: int, primitive: int) -> NDArray[Any]:
        """Return the vertex indices (N,) of a primitive's face corners in the original file, in order."""
        return self.source.corners(self._primitive(node, primitive))

    def _primitive(self, node: int, number: int) -> Header:
        mesh = int(self.source.header["nodes"][node]["mesh"])
        return self.source.header["meshes"][mesh]["primitives"][number]

    def zeros(self, count: int) -> int:
        """Append an accessor of `count` zero vectors, for which glTF stores no data, and return its index."""
        nothing = [0.0, 0.0, 0.0]
        accessor = {"componentType": FLOAT, "count": count, "type": "VEC3", "min": nothing, "max": nothing}
        return self.append("accessors", accessor)

    def write(self, target: Path) -> None:
        """Write the file, as GLB if `target` ends in .glb, or else as glTF with embedded data."""
        write_file(target, self.encode(binary=target.suffix.lower() == ".glb"))
