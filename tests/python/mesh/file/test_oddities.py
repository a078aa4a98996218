"""Valid oddities that programs write, each read as it is meant."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, checkered, look_of, obj_cube, same_shape, write

from dfd.mesh.mesh import Mesh, load


def refusal(gltf: Gltf | bytes, folder: Path) -> str:
    path = write(folder / "odd.glb", gltf if isinstance(gltf, bytes) else gltf.glb())
    with pytest.raises(ValueError, match="is not a well-formed GLB file") as caught:
        load(path)
    return str(caught.value)


def cube(**node: object) -> Gltf:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE), **node)
    return gltf


PLY = "ply\nformat {}\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"


def packed_ply(body: bytes, header: str) -> bytes:
    head = PLY.format("binary_little_endian 1.0") + header + "end_header\n"
    return head.encode() + CORNERS.astype("<f4").tobytes() + body


def test_binary_ply_with_triangles_and_quads(tmp_path: Path) -> None:
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    body = b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    header = f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    mesh = load(write(tmp_path / "mixed.ply", packed_ply(body, header)))
    assert same_shape(mesh, Mesh(CORNERS, CUBE))
    with pytest.raises(ValueError, match="is cut off before the end of its 8 rows of 'face'"):
        load(write(tmp_path / "cut.ply", packed_ply(body[:-3], header)))


def test_text_ply_with_two_lists_of_several_lengths(tmp_path: Path) -> None:
    text = PLY.format("ascii 1.0") + "element face 2\nproperty list uchar int vertex_indices\n"
    text += "property list uchar float texcoord\nend_header\n" + "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in CORNERS)
    mesh = load(write(tmp_path / "lists.ply", text + "3 0 1 2 6 0 .5 0 1 1 1\n4 4 5 7 6 8 0 0 0 1 1 1 1 .5\n"))
    assert mesh.faces.tolist() == [[0, 1, 2], [4, 5, 7], [4, 7, 6]]


def test_ply_strips_of_triangles(tmp_path: Path) -> None:
    strip = [0, 1, 2, 3, -1, 4, 6, 5, 7]
    body = struct.pack(f"<i{len(strip)}i", len(strip), *strip)
    mesh = load(
        write(tmp_path / "s.ply", packed_ply(body, "element tristrips 1\nproperty list int int vertex_indices\n"))
    )
    assert mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3], [4, 6, 5], [5, 6, 7]]


def test_a_picture_of_a_ply_that_cannot_be_read_is_a_warning(tmp_path: Path) -> None:
    text = PLY.format("ascii 1.0").replace("\nelement", "\ncomment TextureFile paint.png\nelement", 1)
    text += "property float s\nproperty float t\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
    text += "".join(f"{x:g} {y:g} {z:g} {x:g} {y:g}\n" for x, y, z in CORNERS)
    text += "".join("3 {} {} {}\n".format(*face) for face in CUBE)
    write(tmp_path / "paint.png", "no picture")
    with pytest.warns(UserWarning, match="paint.png"):
        load(write(tmp_path / "cube.ply", text))
    checkered(tmp_path / "paint.png")
    assert look_of(tmp_path / "cube.ply").materials[0].texture is not None


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize("ending", ["obj", "off", "ply"])
@pytest.mark.parametrize("turned", [False, True])
def test_concave_polygons_become_triangles_inside_them(ending: str, turned: bool, tmp_path: Path) -> None:
    outline = [(0, 0, 0), (4, 0, 0), (4, 3, 0), (3, 3, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)]  # a U
    order = range(7, -1, -1) if turned else range(8)
    numbers = " ".join(map(str, order))
    vertices = "".join(f"{x} {y} {z}\n" for x, y, z in outline)
    text = {
        "obj": "".join(f"v {x} {y} {z}\n" for x, y, z in outline) + "f " + " ".join(str(i + 1) for i in order) + "\n",
        "off": f"OFF\n8 1 0\n{vertices}8 {numbers}\n",
        "ply": PLY.format("ascii 1.0") + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        + f"{vertices}8 {numbers}\n",
    }[ending]  # fmt: skip
    mesh = load(write(tmp_path / f"u.{ending}", text))
    assert len(mesh.faces) == 6
    assert area(mesh) == pytest.approx(8)
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    assert (np.sign(np.cross(b - a, c - a)[:, 2]) == (-1 if turned else 1)).all()


def test_a_scene_of_too_many_primitives_is_refused(tmp_path: Path) -> None:
    gltf = cube()
    gltf.header["nodes"] = [{"mesh": 0}] * 100_001
    gltf.header["scenes"] = [{"nodes": list(range(100_001))}]
    assert "its scene places more than 100000 primitives" in refusal(gltf, tmp_path)
    gltf = cube()
    gltf.header["meshes"][0]["primitives"] *= 20_001
    assert "its scene shows more than 20000 primitives" in refusal(gltf, tmp_path)


@pytest.mark.parametrize("letters", [b"caf\xe9", b"\x83e\x83X\x83g", b"\xff\xfe\x00"])
def test_letters_in_no_encoding_and_an_stl_file_in_capitals(letters: bytes, tmp_path: Path) -> None:
    cube = Mesh(CORNERS, CUBE)
    lines = [b"SOLID " + letters]
    for face in CUBE:
        lines += [b"FACET NORMAL 0 0 0", b"OUTER LOOP"]
        lines += [b"VERTEX %g %g %g" % tuple(CORNERS[corner]) for corner in face] + [b"ENDLOOP", b"ENDFACET"]
    write(tmp_path / "cube.stl", b"\n".join([*lines, b"ENDSOLID", b""]))
    for ending, before, after in (("off", b"OFF\n", b"OFF\n# %s\n"), ("ply", b"\nelement", b"\ncomment %s\nelement")):
        path = tmp_path / f"cube.{ending}"
        cube.save(path)
        write(path, path.read_bytes().replace(before, after % letters, 1))
    write(tmp_path / "cube.obj", b"# " + letters + b"\n" + obj_cube().encode())
    for path in tmp_path.iterdir():
        assert same_shape(load(path), cube)
