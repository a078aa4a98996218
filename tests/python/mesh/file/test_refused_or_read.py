"""Files that programs write and the formats allow are read; what is wrong in them is named; nothing else is written."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, checkered, obj_cube, same_shape, textured_quad, write

import dfd
from dfd.mesh.mesh import Mesh, load

SECRET = "password = hunter2\n"


# --- what is written beside an OBJ file ---


def stranger(folder: Path, library: str, content: str) -> Mesh:
    folder.mkdir()
    write(folder / library, content)
    return load(write(folder / "chair.obj", f"mtllib {library}\n" + obj_cube().replace("f ", "usemtl wood\nf ", 1)))


@pytest.mark.parametrize("library", ["json.py", "Makefile", "notes.txt"])
def test_a_library_plants_no_file_and_carries_no_text_away(library: str, tmp_path: Path) -> None:
    mesh = stranger(tmp_path / "in", library, SECRET + "newmtl other\nKd 1 0 0\n")
    (tmp_path / "out").mkdir()
    mesh.save(tmp_path / "out" / "chair.obj", mesh.vertices + 1)
    assert [each.name for each in (tmp_path / "out").iterdir()] == ["chair.obj"]


def test_only_used_materials_are_written_under_the_name_of_the_file(tmp_path: Path) -> None:
    mesh = stranger(tmp_path / "in", "json.py", SECRET + "newmtl wood\nKd 1 0 0\nnewmtl other\nKd 0 1 0\n")
    (tmp_path / "out").mkdir()
    mesh.save(tmp_path / "out" / "chair.obj", mesh.vertices + 1)
    assert {each.name for each in (tmp_path / "out").iterdir()} == {"chair.obj", "chair.mtl"}
    assert (tmp_path / "out" / "chair.mtl").read_text().split() == ["newmtl", "wood", "Kd", "1", "0", "0"]
    assert "json.py" not in (tmp_path / "out" / "chair.obj").read_text()
    again = load(tmp_path / "out" / "chair.obj")
    assert again.appearance is not None
    assert any(material.color == (1, 0, 0, 1) for material in again.appearance.materials)


def test_a_picture_is_written_under_the_name_of_one(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    checkered(folder / "paint.png").rename(folder / "json.py")
    (folder / "a.mtl").write_text("newmtl wood\nmap_Kd json.py\n")
    text = "mtllib a.mtl\nvt 0 0\n" + obj_cube().replace("f ", "usemtl wood\nf ", 1)
    mesh = load(write(folder / "chair.obj", text))
    (tmp_path / "out").mkdir()
    mesh.save(tmp_path / "out" / "chair.obj", mesh.vertices + 1)
    assert {each.name for each in (tmp_path / "out").iterdir()} == {"chair.obj", "chair.mtl", "json.png"}


@pytest.mark.parametrize("kind", ["obj", "glb"])
def test_materials_of_another_file_are_never_overwritten(kind: str, tmp_path: Path) -> None:
    if kind == "glb":
        mesh = load(write(tmp_path / "quad.glb", textured_quad(tmp_path).glb()))
    else:
        mesh = stranger(tmp_path / "in", "a.mtl", "newmtl wood\nKd 1 0 0\n")
    (tmp_path / "to").mkdir()
    out = tmp_path / "to" / "out.obj"
    write(out.with_suffix(".mtl"), "newmtl mine\nKd 0 0 1\n")
    for _ in range(2):  # written once more it keeps to its own names
        mesh.save(out, mesh.vertices + 1)
        assert out.with_suffix(".mtl").read_text() == "newmtl mine\nKd 0 0 1\n"
        assert "mtllib out_2.mtl" in out.read_text()
        assert sorted(each.name for each in out.parent.glob("*.mtl")) == ["out.mtl", "out_2.mtl"]
    assert load(out).appearance is not None


# --- glTF ---


def refusal(gltf: Gltf | bytes, folder: Path) -> str:
    path = write(folder / "odd.glb", gltf if isinstance(gltf, bytes) else gltf.glb())
    with pytest.raises(ValueError, match="is not a well-formed GLB file") as caught:
        load(path)
    return str(caught.value)


def cube(**node: object) -> Gltf:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE), **node)
    return gltf


def test_a_buffer_takes_no_file_along_that_is_none(tmp_path: Path) -> None:
    gltf = cube()
    write(tmp_path / "secret.txt", SECRET * 1000)
    gltf.header["buffers"] = [{"uri": "secret.txt", "byteLength": len(gltf.data)}]
    with pytest.raises(ValueError, match=r"buffer 0 should have \d+ bytes, but 'secret.txt' has 19000"):
        load(write(tmp_path / "a.gltf", json.dumps(gltf.header)))
    write(tmp_path / "data.bin", gltf.data + SECRET.encode() * 1000)
    gltf.header["buffers"][0]["uri"] = "data.bin"
    mesh = load(write(tmp_path / "b.gltf", json.dumps(gltf.header)))
    mesh.save(tmp_path / "out.glb", mesh.vertices + 1)
    assert b"hunter2" not in (tmp_path / "out.glb").read_bytes()  # only what the header says is the buffer's


def test_a_wrong_total_length_is_named(tmp_path: Path) -> None:
    data = cube().glb()
    assert "it should have" in refusal(data[:8] + struct.pack("<I", len(data) + 4) + data[12:], tmp_path)
    assert "it should have" in refusal(data + bytes(8), tmp_path)


@pytest.mark.parametrize("stride", [0, 1, 2])
def test_strides_that_the_format_forbids_are_named(stride: int, tmp_path: Path) -> None:
    gltf = cube()
    gltf.header["bufferViews"][0]["byteStride"] = stride
    assert f"bufferView 0 has the byteStride {stride}, but items of accessor 0 have 12 bytes" in refusal(gltf, tmp_path)


def test_indices_are_unsigned_whole_numbers(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    gltf.header["meshes"][0]["primitives"][0]["indices"] = gltf.accessor(CUBE.ravel(), 5126, "SCALAR")
    assert "of indices, must hold unsigned whole numbers" in refusal(gltf, tmp_path)


@pytest.mark.parametrize(("component", "dtype"), [(5120, "i1"), (5124, "<i4"), (None, "u1"), ("u1", "u1")])
def test_a_sparse_item_is_counted_by_an_unsigned_number(component: object, dtype: str, tmp_path: Path) -> None:
    gltf = cube()
    gltf.header["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": gltf.view(np.array([-1 if "i" in dtype else 1], dtype).tobytes()),
                    "componentType": component},
        "values": {"bufferView": gltf.view(np.full(3, 9, "<f4").tobytes())},
    }  # fmt: skip
    assert "is sparse, but counts its items in the componentType" in refusal(gltf, tmp_path)


def test_an_accessor_without_data_is_zeros(tmp_path: Path) -> None:
    gltf = cube()
    flat = {"count": 8, "componentType": 5126, "type": "VEC3"}
    gltf.header["accessors"].append(flat)
    primitive = gltf.header["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}]
    primitive["attributes"]["POSITION"] = 2
    gltf.header["meshes"][0]["weights"] = [1]
    assert same_shape(load(write(tmp_path / "flat.glb", gltf.glb())), Mesh(CORNERS, CUBE))


def test_a_false_count_of_a_draco_accessor_is_named(tmp_path: Path) -> None:
    draco = pytest.importorskip("DracoPy")
    gltf = cube()
    packed = {"bufferView": gltf.view(draco.encode(CORNERS, CUBE.astype(np.uint32))), "attributes": {"POSITION": 0}}
    gltf.header["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": packed}
    gltf.header["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    for accessor in gltf.header["accessors"]:
        del accessor["bufferView"]
    gltf.header["accessors"][0]["count"] = 7
    assert "accessor 0 has 7 items, but KHR_draco_mesh_compression holds 8" in refusal(gltf, tmp_path)


# --- PLY, STL, OFF and polygons ---

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
    with pytest.raises(ValueError, match="should have 8 of 'face', but is cut off"):
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
    look = load(tmp_path / "cube.ply").appearance
    assert look is not None
    assert look.materials[0].texture is not None


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


def test_an_stl_file_in_capitals(tmp_path: Path) -> None:
    Mesh(CORNERS, CUBE).save(tmp_path / "cube.off")
    lines = ["SOLID CUBE"]
    for face in CUBE:
        lines += ["FACET NORMAL 0 0 0", "OUTER LOOP"]
        lines += [f"VERTEX {x:g} {y:g} {z:g}" for x, y, z in CORNERS[face]] + ["ENDLOOP", "ENDFACET"]
    mesh = load(write(tmp_path / "cube.stl", "\n".join([*lines, "ENDSOLID CUBE", ""])))
    assert same_shape(mesh, Mesh(CORNERS, CUBE))


@pytest.mark.parametrize("ending", ["obj", "ply"])
def test_faces_of_two_corners_are_told(ending: str, tmp_path: Path) -> None:
    text = obj_cube() + "f 1 2\n"
    if ending == "ply":
        text = PLY.format("ascii 1.0") + "element face 13\nproperty list uchar int vertex_indices\nend_header\n"
        text += "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in CORNERS)
        text += "".join("3 {} {} {}\n".format(*face) for face in CUBE) + "2 0 1\n"
    with pytest.warns(UserWarning, match="1 faces of fewer than three corners"):
        mesh = load(write(tmp_path / f"short.{ending}", text))
    assert len(mesh.faces) == 12


# --- words ---


@pytest.mark.parametrize("shape", ["(9000000000000, 3)", "(1, 'a", "(1, 2"])
def test_rows_whose_header_is_wrong_are_named_in_one_line(shape: str, tmp_path: Path) -> None:
    head = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}"
    head += " " * (117 - len(head)) + "\n"
    data = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + bytes(64)
    with pytest.raises(ValueError, match="must be an .npy file of numbers") as caught:
        dfd.Field.load(write(tmp_path / "rows.npy", data), mesh=Mesh(CORNERS, CUBE))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_long_names_are_not_repeated(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("x" * 9000, CORNERS, CUBE + 3))
    with pytest.raises(ValueError, match="faces between vertices") as caught:
        load(write(tmp_path / "long.glb", gltf.glb()))
    assert len(str(caught.value)) < 500
    picture = "y" * 9000 + ".png"
    write(tmp_path / "a.mtl", f"newmtl wood\nmap_Kd {picture}\n")
    with pytest.warns(UserWarning, match="could not be read") as told:
        load(write(tmp_path / "a.obj", "mtllib a.mtl\nusemtl wood\n" + obj_cube()))
    assert len(str(told[0].message)) < 500


def test_a_falloff_that_is_none_is_named() -> None:
    with pytest.raises(ValueError, match="bind: `falloff` must be a name or one for each handle, got None"):
        dfd.bind(np.eye(4, dtype=np.float32), [0], falloff=None)  # type: ignore[arg-type]


# --- limits ---


def test_a_scene_of_too_many_primitives_is_refused(tmp_path: Path) -> None:
    gltf = cube()
    gltf.header["nodes"] = [{"mesh": 0}] * 100_001
    gltf.header["scenes"] = [{"nodes": list(range(100_001))}]
    assert "its scene places more than 100000 primitives" in refusal(gltf, tmp_path)
    gltf = cube()
    gltf.header["meshes"][0]["primitives"] *= 20_001
    assert "its scene shows more than 20000 primitives" in refusal(gltf, tmp_path)


def test_a_picture_beyond_the_budget_is_not_decoded(tmp_path: Path) -> None:
    from PIL import Image

    gltf, stream = textured_quad(tmp_path), io.BytesIO()
    Image.new("1", (11_000, 11_000)).save(stream, "PNG")
    gltf.header["images"][0]["bufferView"] = gltf.view(stream.getvalue())
    with pytest.warns(UserWarning, match="could not be read"):
        load(write(tmp_path / "large.glb", gltf.glb()))
