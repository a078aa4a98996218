"""What programs write beyond the letter of OBJ, PLY, STL and OFF: read in every format, or named."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, checkered, look_of, write

from dfd.mesh.mesh import Mesh, load

TRIANGLE = ["0 0 0", "1 0 0", "0 1 0"]
RED, GREEN = (1, 0, 0, 1), (0, 1, 0, 1)


def reads(path: Path, content: str | bytes) -> Mesh:
    """Read a file, check that moved vertices can be saved in its format and in GLB, and return the mesh."""
    mesh = load(write(path, content))
    moved = mesh.vertices * 2 + (1, 2, 3)
    mesh.save(path.with_name(f"moved{path.suffix}"), moved)
    again = load(path.with_name(f"moved{path.suffix}"))
    assert np.allclose(again.vertices, moved, rtol=0, atol=1e-6)
    mesh.save(path.with_name("moved.glb"), moved)
    look = load(path.with_name("moved.glb")).appearance
    assert (look is None) == (mesh.appearance is None)
    if look is not None and mesh.appearance is not None:
        faces, middle = np.arange(len(mesh.faces)), np.full((len(mesh.faces), 3), 1 / 3, np.float32)
        assert np.allclose(look.albedo(faces, middle), mesh.appearance.albedo(faces, middle), atol=0.01)
    return mesh


# OFF


@pytest.mark.parametrize(
    "head", ["OFF3 1 0\n", "OFF 3 1 0\n", "OFF\n3 1\n", "OFF\n3\n1\n0\n", "3 1 0\n", "off\n3 1 0\n", "OFF3 1\n"]
)
def test_headers_of_off_files(head: str, tmp_path: Path) -> None:
    mesh = reads(tmp_path / "a.off", head + "\n".join([*TRIANGLE, "3 0 1 2", ""]))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    "body",
    [
        "0 0 0 1 0 0\n0 1 0\n3 0 1 2\n",
        "0 0 0 1 0 0 0 1 0 3 0 1 2",
        "0 0\n0 1 0 0 0 # half\n1 0\n3 0 1 2",
        "0\n0\n0\n1\n0\n0\n0\n1\n0\n3 0\n1 2\n",
    ],
)
def test_vertices_of_an_off_file_may_end_anywhere(body: str, tmp_path: Path) -> None:
    mesh = reads(tmp_path / "a.off", f"OFF\n3 1 0\n{body}")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("ending", ["off", "ply", "obj"])
def test_a_face_of_two_corners_is_left_out_and_said(ending: str, tmp_path: Path) -> None:
    text = {
        "off": "\n".join(["OFF", "3 2 0", *TRIANGLE, "2 0 1", "3 0 1 2", ""]),
        "obj": "\n".join([*(f"v {each}" for each in TRIANGLE), "f 1 2", "f 1 2 3", ""]),
        "ply": ply([], TRIANGLE, faces=["2 0 1", "3 0 1 2"]),
    }[ending]
    with pytest.warns(UserWarning, match="has 1 faces of fewer than three corners"):
        assert load(write(tmp_path / f"a.{ending}", text)).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("kind", "columns"),
    [
        ("COFF", "255 0 0 255"),
        ("COFF", "255 0 0"),
        ("COFF", "1.0 0.0 0.0 1.0"),
        ("CNOFF", "0 0 1 255 0 0 255"),
        ("STCNOFF", "0 0 1 1 0 0 1 0.25 0.75"),
        ("coff", "255 0 0"),
        ("NCOFF", "0 0 1 255 0 0 255"),
        ("NCOFF", "255 0 0 255 0 0 1"),
    ],
)
def test_colors_of_the_vertices_of_an_off_file(kind: str, columns: str, tmp_path: Path) -> None:
    mesh = reads(tmp_path / "a.off", "\n".join([kind, "3 1 0", *(f"{row} {columns}" for row in TRIANGLE), "3 0 1 2"]))
    assert np.allclose(mesh.vertex_colors(), RED)
    assert mesh.scene is not None
    geometry = mesh.scene.primitives[0].geometry
    assert (geometry.normals is not None) == ("N" in kind)
    if "ST" in kind:
        assert geometry.uv is not None
        assert geometry.uv.tolist() == [[0.25, 0.75]] * 3


@pytest.mark.parametrize("color", ["255 0 0", "1.0 0 0", "255 0 0 255", "1 0 0 1"])
def test_colors_of_the_faces_of_an_off_file(color: str, tmp_path: Path) -> None:
    green = "0 255 0" if "255" in color else "0 1.0 0"
    rows = [*TRIANGLE, "0 0 1", f"3 0 1 2 {color}", f"3 0 1 3 {green}"]
    look = look_of(reads(tmp_path / "a.off", "\n".join(["OFF", "4 2 0", *rows, ""])))
    assert np.allclose(look.albedo(np.arange(2), np.full((2, 3), 1 / 3, np.float32)), [RED, GREEN], atol=0.01)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 5\n", "colors of faces by their index in a color map are ignored"),
        ("OFF\n3 1 0\n0 0 0 7 7\n1 0 0 7 7\n0 1 0 7 7\n3 0 1 2\n", "2 further numbers of vertices, which"),
    ],
)
def test_what_an_off_file_has_in_vain_is_said(text: str, said: str, tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=said) as found:
        load(write(tmp_path / "a.off", text))
    assert len(found) == 1


@pytest.mark.parametrize("kind", ["4OFF", "4nOFF\n3"])
def test_homogeneous_coordinates_of_an_off_file_are_divided(kind: str, tmp_path: Path) -> None:
    rows = [f"{row} {w}" for row, w in zip(["0 0 0", "2 0 0", "0 4 0"], (1, 2, 4), strict=True)]
    mesh = reads(tmp_path / "a.off", "\n".join([kind, "3 1 0", *rows, "3 0 1 2", ""]))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("OFF BINARY\n3 1 0\n", "it is a binary OFF file, which cannot be read: save it as text"),
        ("nOFF\n4\n3 1 0\n", "its vertices have '4' dimensions, and only 3 can be read"),
        ("OFF\n3 1 0\n0 0 0\n1 0 x\n0 1 0\n3 0 1 2\n", "vertex 1 has the coordinates '1 0 x'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "a face names the vertex '1.5'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "a face names vertex 3, but there are 3 vertices"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "face 0 should have 3 corners, but has 2"),
    ],
)
def test_messages_about_off_files(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        load(write(tmp_path / "a.off", text))


# OBJ


def test_homogeneous_coordinates_of_an_obj_file_are_divided(tmp_path: Path) -> None:
    mesh = reads(tmp_path / "a.obj", "v 0 0 0 1\nv 2 0 0 2\nv 0 1 0\nf 1 2 3\n")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert (tmp_path / "moved.obj").read_text().splitlines()[1] == "v 6.0 4.0 6.0 2"


# PLY


def ply(
    properties: list[str],
    rows: list[str],
    *,
    kind: str = "float",
    faces: list[str] | None = None,
    of_faces: list[str] | None = None,
    comment: str = "made by hand",
) -> str:
    faces = ["3 0 1 2"] if faces is None else faces
    head = ["ply", "format ascii 1.0", f"comment {comment}", f"element vertex {len(rows)}"]
    head += [*(f"property {kind} {axis}" for axis in "xyz"), *(f"property {each}" for each in properties)]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    head += [*(f"property {each}" for each in of_faces or []), "end_header"]
    return "\n".join([*head, *rows, *faces, ""])


@pytest.mark.parametrize(
    ("names", "kind", "color"),
    [
        (("red", "green", "blue"), "float", "255 0 0"),
        (("red", "green", "blue"), "float", "1 0 0"),
        (("red", "green", "blue"), "float", "1.0001 0 0"),
        (("red", "green", "blue"), "double", "65535 0 0"),
        (("red", "green", "blue"), "int", "255 0 0"),
        (("red", "green", "blue"), "ushort", "255 0 0"),
        (("red", "green", "blue"), "ushort", "65535 0 0"),
        (("red", "green", "blue"), "uchar", "1.0 0.0 0.0"),
        (("r", "g", "b"), "uchar", "255 0 0"),
        (("r", "g", "b", "a"), "float", "1 0 0 1"),
        (("Red", "Green", "Blue"), "uint8", "255 0 0"),
        (("diffuse_red", "diffuse_green", "diffuse_blue"), "uchar", "255 0 0"),
    ],
)
def test_colors_of_a_ply_file_by_name_and_range(names: tuple[str, ...], kind: str, color: str, tmp_path: Path) -> None:
    text = ply([f"{kind} {each}" for each in names], [f"{row} {color}" for row in TRIANGLE])
    expected = np.array(RED) if color != "1.0 0.0 0.0" else np.array([1 / 255, 0, 0, 1])
    assert np.allclose(reads(tmp_path / "a.ply", text).vertex_colors(), expected, atol=1e-6)


def test_keywords_of_a_ply_file_in_any_case(tmp_path: Path) -> None:
    text = (
        ply([], TRIANGLE).replace("ply", "PLY", 1).replace("property", "PROPERTY").replace("list uchar", "List UChar")
    )
    text = text.replace("element vertex", "ELEMENT Vertex").replace("vertex_indices", "Vertex_Indices")
    assert reads(tmp_path / "a.ply", text.replace("format ascii", "FORMAT ASCII")).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("kind", ["Float32", "FLOAT", "float64", "int64", "Int32"])
def test_types_of_a_ply_file_in_any_case(kind: str, tmp_path: Path) -> None:
    assert reads(tmp_path / "a.ply", ply([], TRIANGLE, kind=kind)).vertices[1].tolist() == [1, 0, 0]


def test_indices_of_64_bits_in_a_binary_ply_file(tmp_path: Path) -> None:
    head = ply([], TRIANGLE).split("end_header")[0].replace("ascii", "binary_little_endian").replace("int v", "int64 v")
    body = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes() + struct.pack("<B3q", 3, 0, 1, 2)
    assert reads(tmp_path / "a.ply", head.encode() + b"end_header\n" + body).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("comment", ["a tool that adds end_header late", "end_header", "x end_header\ncomment y"])
def test_the_end_of_a_ply_header_in_a_comment(comment: str, tmp_path: Path) -> None:
    reads(tmp_path / "a.ply", ply([], TRIANGLE, comment=comment))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ply([], ["0 0 0", "1 0 0 7", "0 1 0"]), r"line 12: row 1 of 'vertex' has 4 numbers, and 3 are needed"),
        (ply([], ["0 0 0", "1 0", "0 1 0"]), r"line 12: row 1 of 'vertex' has 2 numbers, and 3 are needed"),
        (ply([], TRIANGLE, faces=["3 0 1 2 9"]), r"line 14: row 0 of 'face' has 5 numbers, and 4 are needed"),
        (ply([], TRIANGLE, faces=["4 0 1 2"]), r"line 14: row 0 of 'face' has 4 numbers, and 5 are needed"),
        (ply([], ["0 0 0", "1 not 0", "0 1 0"]), r"line 12 must consist of numbers, got 'not'"),
        (ply([], TRIANGLE, faces=["3 0 1 2.5"]), r"a list of 'vertex_indices' has a fraction"),
    ],
)
def test_a_wrong_row_of_a_ply_file_is_named(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        load(write(tmp_path / "a.ply", text))


def test_properties_without_their_partners_stay_attributes(tmp_path: Path) -> None:
    text = ply(["float nx", "float ny", "uchar red", "float s"], [f"{row} 1 0 7 0.5" for row in TRIANGLE])
    scene = reads(tmp_path / "a.ply", text).scene
    assert scene is not None
    assert set(scene.primitives[0].geometry.attributes) == {"nx", "ny", "red", "s"}


def test_further_textures_of_a_ply_file_are_named(tmp_path: Path) -> None:

    checkered(tmp_path / "a.png")
    text = ply(
        ["float s", "float t"],
        [f"{row} 0 0" for row in TRIANGLE],
        comment="TextureFile a.png\ncomment TextureFile b.png",
    )
    with pytest.warns(UserWarning, match=r"the textures after the first, 'b\.png', are ignored"):
        load(write(tmp_path / "a.ply", text))


# STL


def stl(attributes: list[int], header: bytes = b"") -> bytes:
    faces = np.zeros(12, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    faces["corners"] = CORNERS[CUBE]
    faces["attribute"] = np.resize(attributes, 12)
    return header.ljust(80, b"\0") + struct.pack("<I", 12) + faces.tobytes()


RED_HIGH, GREEN_MIDDLE, RED_LOW = 0xFC00, 0x83E0, 0x001F


@pytest.mark.parametrize(
    ("attributes", "header", "colors"),
    [
        ([RED_HIGH, GREEN_MIDDLE], b"", [RED, GREEN]),
        ([RED_LOW, 0x03E0], b"solid COLOR=\x00\x00\xff\xff", [RED, GREEN]),
        ([RED_LOW, 0x8000], b"solid COLOR=\x00\xff\x00\xff", [RED, GREEN]),
        ([0x8000], b"solid COLOR=\x00\xff\x00\xff", [GREEN, GREEN]),
        ([RED_HIGH, GREEN_MIDDLE], b"solid COLOR=\xff\xff\xff\xff facet normal", [RED, GREEN]),
        ([0, 7], b"", None),
    ],
)
def test_colors_in_the_attributes_of_an_stl_file(
    attributes: list[int], header: bytes, colors: list | None, tmp_path: Path
) -> None:
    mesh = reads(tmp_path / "a.stl", stl(attributes, header))
    if colors is None:
        assert mesh.appearance is None
        return
    middle = np.full((2, 3), 1 / 3, np.float32)
    assert np.allclose(look_of(mesh).albedo(np.arange(2), middle), colors, atol=0.01)
    assert (tmp_path / "moved.stl").read_bytes()[132:134] == struct.pack("<H", attributes[0])


def test_faces_of_an_stl_file_without_a_color_are_said(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="has 6 faces without a color"):
        load(write(tmp_path / "a.stl", stl([RED_HIGH, 0])))
