"""Write small mesh files for tests, and compare meshes."""

import json
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from dfd.mesh.appearance import Appearance
from dfd.mesh.mesh import Mesh, load

# a unit cube: 8 corners, 12 outward triangles
CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE = np.array(
    [
        *[(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5)],
        *[(0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)],
        *[(0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)],
    ]
)


def write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def obj_cube() -> str:
    """Return the text of an OBJ file with a cube."""
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in CORNERS] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in CUBE]
    return "\n".join(lines) + "\n"


def checkered(path: Path, size: int = 4) -> Path:
    """Write a picture of four quarters, red and green above, blue and white below, and return its path."""
    texels = np.zeros((size, size, 3), np.uint8)
    half = size // 2
    texels[:half, :half], texels[:half, half:] = (255, 0, 0), (0, 255, 0)
    texels[half:, :half], texels[half:, half:] = (0, 0, 255), (255, 255, 255)
    Image.fromarray(texels).save(path)
    return path


def painted_cube(folder: Path) -> Path:
    """Write an OBJ file of a cube with the texture `paint.png`, and return its path."""
    checkered(folder / "paint.png", 64)
    write(folder / "cube.mtl", "newmtl paint\nmap_Kd paint.png\n")
    faces = re.sub(r"(?<=[f\d]) (\d+)", r" \1/1", "".join(re.findall(r"f .*\n", obj_cube())))
    vertices = "".join(re.findall(r"v .*\n", obj_cube()))
    return write(folder / "cube.obj", f"mtllib cube.mtl\nvt 0 0\n{vertices}usemtl paint\n{faces}")


class Gltf:
    """Builds a glTF file with one buffer. Methods add an item and return its index."""

    def __init__(self) -> None:
        self.header: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{name: [] for name in ("nodes", "meshes", "accessors", "bufferViews")},
        }
        self.data = b""

    def view(self, data: bytes) -> int:
        self.header["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        self.data += data + b"\0" * (-len(data) % 4)
        return len(self.header["bufferViews"]) - 1

    def accessor(self, values: Any, component: int, kind: str) -> int:
        dtype = {5126: "<f4", 5125: "<u4", 5121: "u1"}[component]
        view = self.view(np.asarray(values, dtype).tobytes())
        accessor = {"bufferView": view, "componentType": component, "count": len(values), "type": kind}
        self.header["accessors"].append(accessor)
        return len(self.header["accessors"]) - 1

    def mesh(self, name: str, vertices: Any, faces: Any, **primitive: Any) -> int:
        """Add a mesh of one primitive, and return its index."""
        attributes = {"POSITION": self.accessor(vertices, 5126, "VEC3"), **primitive.pop("attributes", {})}
        indices = self.accessor(np.ravel(faces), 5125, "SCALAR")
        self.header["meshes"].append(
            {"name": name, "primitives": [{"attributes": attributes, "indices": indices, **primitive}]}
        )
        return len(self.header["meshes"]) - 1

    def node(self, **node: Any) -> int:
        self.header["nodes"].append(node)
        self.header["scenes"][0]["nodes"].append(len(self.header["nodes"]) - 1)
        return len(self.header["nodes"]) - 1

    def image(self, path: Path) -> None:
        """Add a texture, and a material with the index 0 that uses it."""
        self.header["images"] = [{"bufferView": self.view(path.read_bytes()), "mimeType": "image/png"}]
        self.header["textures"] = [{"source": 0}]
        self.header["materials"] = [{"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]

    def glb(self) -> bytes:
        if self.data:
            self.header["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps({key: value for key, value in self.header.items() if value != []}).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.data), 0x004E4942) + self.data
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def textured_quad(tmp_path: Path, **attributes: Any) -> Gltf:
    """Return a square in the plane z = 0 that the texture covers once: u to the right, v up."""
    gltf = Gltf()
    uv = gltf.accessor([(0, 1), (1, 1), (1, 0), (0, 0)], 5126, "VEC2")
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    extra = {name: gltf.accessor(*values) for name, values in attributes.items()}
    gltf.mesh("square", square, [(0, 1, 2), (0, 2, 3)], attributes={"TEXCOORD_0": uv, **extra}, material=0)
    gltf.image(checkered(tmp_path / "paint.png"))
    gltf.node(name="square", mesh=0)
    return gltf


def scene_of_three(tmp_path: Path) -> Path:
    """Write a textured square, and a colored cube that is placed twice, once rotated and scaled."""
    gltf = textured_quad(tmp_path)
    colors = np.tile(np.array([(255, 0, 0, 255), (0, 255, 0, 255)], np.uint8), (4, 1))
    cube = gltf.mesh("cube", CORNERS, CUBE, attributes={"COLOR_0": gltf.accessor(colors, 5121, "VEC4")})
    gltf.header["accessors"][gltf.header["meshes"][cube]["primitives"][0]["attributes"]["COLOR_0"]]["normalized"] = True
    half = float(np.sqrt(0.5))
    gltf.node(name="near", mesh=cube, translation=[3, 0, 0])
    gltf.node(name="far", mesh=cube, translation=[0, 0, -9], rotation=[0, half, 0, half], scale=[0.5, 2, 1])
    return write(tmp_path / "three.glb", gltf.glb())


def look_of(source: Path | Mesh) -> Appearance:
    """Return the appearance of a mesh or a file; AssertionError if it has none."""
    mesh = source if isinstance(source, Mesh) else load(source)
    return mesh.appearance


def same_shape(a: Mesh, b: Mesh, tolerance: float = 1e-6) -> bool:
    """Return whether two meshes have the same triangles in the same order, for any order of vertices."""
    return a.faces.shape == b.faces.shape and np.allclose(
        a.vertices[a.faces], b.vertices[b.faces], rtol=0, atol=tolerance
    )


def header_and_data(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def view_bytes(path: Path, view: int) -> bytes:
    header, data = header_and_data(path)
    found = header["bufferViews"][view]
    return data[found["byteOffset"] : found["byteOffset"] + found["byteLength"]]


def bent(vertices: np.ndarray) -> np.ndarray:
    """Return vertices moved by a smooth function of their positions."""
    return vertices + 0.3 * np.stack([np.sin(vertices[:, 1]), vertices[:, 2] ** 2, np.cos(vertices[:, 0])], axis=1)


def normals_of(path: Path) -> list[np.ndarray]:
    """Return the normals in a file, in the axes of its scene, one array for each primitive that has normals."""
    primitives = load(path).scene.primitives
    return [np.asarray(each.normals_to_scene(each.normals)) for each in primitives if each.normals is not None]


def ply(
    properties: list[str],
    rows: list[str],
    *,
    kind: str = "float",
    faces: Sequence[str] = ("3 0 1 2",),
    of_faces: Sequence[str] = (),
    comment: str = "made by hand",
) -> str:
    """Return a PLY file of text: a position of the type `kind` and further properties for each vertex, and faces."""
    head = ["ply", "format ascii 1.0", f"comment {comment}", f"element vertex {len(rows)}"]
    head += [*(f"property {kind} {axis}" for axis in "xyz"), *(f"property {each}" for each in properties)]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    head += [*(f"property {each}" for each in of_faces), "end_header"]
    return "\n".join([*head, *rows, *faces, ""])
