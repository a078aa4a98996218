"""What programs write beyond the letter of OBJ, PLY, STL and OFF: read in every format, or named."""

import struct

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, bent, checkered, look_of, normals_of, obj_cube, ply, same_shape, write

from dfd.mesh.mesh import Mesh, load

TRIANGLE = ["0 0 0", "1 0 0", "0 1 0"]
RED, GREEN = (1, 0, 0, 1), (0, 1, 0, 1)


def reads(path, content):
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
def test_headers_of_off_files(head, tmp_path):
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
def test_vertices_of_an_off_file_may_end_anywhere(body, tmp_path):
    mesh = reads(tmp_path / "a.off", f"OFF\n3 1 0\n{body}")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("ending", ["off", "ply", "obj"])
def test_a_face_of_two_corners_is_left_out_and_said(ending, tmp_path):
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
def test_colors_of_the_vertices_of_an_off_file(kind, columns, tmp_path):
    mesh = reads(tmp_path / "a.off", "\n".join([kind, "3 1 0", *(f"{row} {columns}" for row in TRIANGLE), "3 0 1 2"]))
    assert np.allclose(mesh.vertex_colors(), RED)
    geometry = mesh.scene.primitives[0].geometry
    assert (geometry.normals is not None) == ("N" in kind)
    if "ST" in kind:
        assert geometry.uv.tolist() == [[0.25, 0.75]] * 3


@pytest.mark.parametrize("color", ["255 0 0", "1.0 0 0", "255 0 0 255", "1 0 0 1"])
def test_colors_of_the_faces_of_an_off_file(color, tmp_path):
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
def test_what_an_off_file_has_in_vain_is_said(text, said, tmp_path):
    with pytest.warns(UserWarning, match=said) as found:
        load(write(tmp_path / "a.off", text))
    assert len(found) == 1


@pytest.mark.parametrize("kind", ["4OFF", "4nOFF\n3"])
def test_homogeneous_coordinates_of_an_off_file_are_divided(kind, tmp_path):
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
def test_messages_about_off_files(text, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        load(write(tmp_path / "a.off", text))


# OBJ


def test_homogeneous_coordinates_of_an_obj_file_are_divided(tmp_path):
    mesh = reads(tmp_path / "a.obj", "v 0 0 0 1\nv 2 0 0 2\nv 0 1 0\nf 1 2 3\n")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert (tmp_path / "moved.obj").read_text().splitlines()[1] == "v 6.0 4.0 6.0 2"


# PLY


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
def test_colors_of_a_ply_file_by_name_and_range(names, kind, color, tmp_path):
    text = ply([f"{kind} {each}" for each in names], [f"{row} {color}" for row in TRIANGLE])
    expected = np.array(RED) if color != "1.0 0.0 0.0" else np.array([1 / 255, 0, 0, 1])
    assert np.allclose(reads(tmp_path / "a.ply", text).vertex_colors(), expected, atol=1e-6)


def test_keywords_of_a_ply_file_in_any_case(tmp_path):
    text = (
        ply([], TRIANGLE).replace("ply", "PLY", 1).replace("property", "PROPERTY").replace("list uchar", "List UChar")
    )
    text = text.replace("element vertex", "ELEMENT Vertex").replace("vertex_indices", "Vertex_Indices")
    assert reads(tmp_path / "a.ply", text.replace("format ascii", "FORMAT ASCII")).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("kind", ["Float32", "FLOAT", "float64", "int64", "Int32"])
def test_types_of_a_ply_file_in_any_case(kind, tmp_path):
    assert reads(tmp_path / "a.ply", ply([], TRIANGLE, kind=kind)).vertices[1].tolist() == [1, 0, 0]


def test_indices_of_64_bits_in_a_binary_ply_file(tmp_path):
    head = ply([], TRIANGLE).split("end_header")[0].replace("ascii", "binary_little_endian").replace("int v", "int64 v")
    body = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes() + struct.pack("<B3q", 3, 0, 1, 2)
    assert reads(tmp_path / "a.ply", head.encode() + b"end_header\n" + body).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("comment", ["a tool that adds end_header late", "end_header", "x end_header\ncomment y"])
def test_the_end_of_a_ply_header_in_a_comment(comment, tmp_path):
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
def test_a_wrong_row_of_a_ply_file_is_named(text, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        load(write(tmp_path / "a.ply", text))


def test_properties_without_their_partners_stay_attributes(tmp_path):
    text = ply(["float nx", "float ny", "uchar red", "float s"], [f"{row} 1 0 7 0.5" for row in TRIANGLE])
    scene = reads(tmp_path / "a.ply", text).scene
    assert set(scene.primitives[0].geometry.attributes) == {"nx", "ny", "red", "s"}


def test_further_textures_of_a_ply_file_are_named(tmp_path):

    checkered(tmp_path / "a.png")
    text = ply(
        ["float s", "float t"],
        [f"{row} 0 0" for row in TRIANGLE],
        comment="TextureFile a.png\ncomment TextureFile b.png",
    )
    with pytest.warns(UserWarning, match=r"the textures after the first, 'b\.png', are ignored"):
        load(write(tmp_path / "a.ply", text))


# STL


def stl(attributes, header=b""):
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
def test_colors_in_the_attributes_of_an_stl_file(attributes, header, colors, tmp_path):
    mesh = reads(tmp_path / "a.stl", stl(attributes, header))
    if colors is None:
        assert mesh.appearance is None
        return
    middle = np.full((2, 3), 1 / 3, np.float32)
    assert np.allclose(look_of(mesh).albedo(np.arange(2), middle), colors, atol=0.01)
    assert (tmp_path / "moved.stl").read_bytes()[132:134] == struct.pack("<H", attributes[0])


def test_faces_of_an_stl_file_without_a_color_are_said(tmp_path):
    with pytest.warns(UserWarning, match="has 6 faces without a color"):
        load(write(tmp_path / "a.stl", stl([RED_HIGH, 0])))


MSVC = ["nan", "-nan(ind)", "1.#INF00"]


def stl_text(normal="0 0 1", end="endsolid", name="left"):
    facets = [
        f"facet normal {normal if not index else '0 0 1'}\n outer loop\n"
        + "".join(f"  vertex {x:g} {y:g} {z:g}\n" for x, y, z in CORNERS[face].tolist())
        + " endloop\nendfacet\n"
        for index, face in enumerate(CUBE)
    ]
    solids = [f"solid {each}\n{''.join(facets)}{end} {each}\n" for each in (name, "right")]
    return "".join(solids)


@pytest.mark.parametrize("number", MSVC)
def test_normals_that_are_no_numbers_are_missing_and_their_text_stays(number, tmp_path):
    three = f"{number} {number} {number}"
    corners = "".join(f"f {a + 1}//1 {b + 1}//2 {c + 1}//1\n" for a, b, c in CUBE.tolist())
    vertices = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in CORNERS.tolist())
    rows = [f"{x:g} {y:g} {z:g} {three if not i else '0 0 1'}" for i, (x, y, z) in enumerate(CORNERS.tolist())]
    faces = [f"3 {a} {b} {c}" for a, b, c in CUBE.tolist()]
    files = {
        "a.obj": f"{vertices}vn 0 0 1\nvn {three}\n{corners}",
        "a.ply": ply(["float nx", "float ny", "float nz"], rows, faces=faces),
        "a.stl": stl_text(three),
        "a.off": "\n".join(["NOFF", "8 12 0", *rows, *faces, ""]),
    }
    for name, text in files.items():
        mesh = load(write(tmp_path / name, text))
        mesh.save(tmp_path / f"same_{name}")
        assert (tmp_path / f"same_{name}").read_text() == text
        moved = bent(mesh.vertices)
        mesh.save(tmp_path / f"moved_{name}", moved)
        assert three in (tmp_path / f"moved_{name}").read_text()
        assert np.allclose(load(tmp_path / f"moved_{name}").vertices, moved, rtol=0, atol=1e-6)
        mesh.save(tmp_path / "a.glb", moved)
        assert all(np.allclose(np.linalg.norm(each, axis=1), 1) for each in normals_of(tmp_path / "a.glb"))
    assert load(tmp_path / "a.stl").part_names == ("left", "right")


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + stl_text(),
        stl_text(end="end solid"),
        stl_text(name="facet vertex"),
        stl_text().replace("endf", "end f"),
    ],
)
def test_stl_text_with_a_mark_spaces_or_keywords_in_names_is_read_and_stays_text(text, tmp_path):
    mesh = load(write(tmp_path / "a.stl", text))
    assert len(mesh.parts) == 2
    moved = bent(mesh.vertices)
    mesh.save(tmp_path / "moved.stl", moved)
    assert np.allclose(load(tmp_path / "moved.stl").vertices, moved, rtol=0, atol=1e-12)
    assert (tmp_path / "moved.stl").read_text().startswith(text[: text.index("\n")])


PLY_HEAD = "ply\nformat {}\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"


def packed_ply(body, header):
    head = PLY_HEAD.format("binary_little_endian 1.0") + header + "end_header\n"
    return head.encode() + CORNERS.astype("<f4").tobytes() + body


def test_binary_ply_with_triangles_and_quads(tmp_path):
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    body = b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    header = f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    mesh = load(write(tmp_path / "mixed.ply", packed_ply(body, header)))
    assert same_shape(mesh, Mesh(CORNERS, CUBE))
    with pytest.raises(ValueError, match="is cut off before the end of its 8 rows of 'face'"):
        load(write(tmp_path / "cut.ply", packed_ply(body[:-3], header)))


def test_text_ply_with_two_lists_of_several_lengths(tmp_path):
    text = PLY_HEAD.format("ascii 1.0") + "element face 2\nproperty list uchar int vertex_indices\n"
    text += "property list uchar float texcoord\nend_header\n" + "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in CORNERS)
    mesh = load(write(tmp_path / "lists.ply", text + "3 0 1 2 6 0 .5 0 1 1 1\n4 4 5 7 6 8 0 0 0 1 1 1 1 .5\n"))
    assert mesh.faces.tolist() == [[0, 1, 2], [4, 5, 7], [4, 7, 6]]


def test_ply_strips_of_triangles(tmp_path):
    strip = [0, 1, 2, 3, -1, 4, 6, 5, 7]
    body = struct.pack(f"<i{len(strip)}i", len(strip), *strip)
    mesh = load(
        write(tmp_path / "s.ply", packed_ply(body, "element tristrips 1\nproperty list int int vertex_indices\n"))
    )
    assert mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3], [4, 6, 5], [5, 6, 7]]


def test_a_picture_of_a_ply_that_cannot_be_read_is_a_warning(tmp_path):
    text = PLY_HEAD.format("ascii 1.0").replace("\nelement", "\ncomment TextureFile paint.png\nelement", 1)
    text += "property float s\nproperty float t\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
    text += "".join(f"{x:g} {y:g} {z:g} {x:g} {y:g}\n" for x, y, z in CORNERS)
    text += "".join("3 {} {} {}\n".format(*face) for face in CUBE)
    write(tmp_path / "paint.png", "no picture")
    with pytest.warns(UserWarning, match="paint.png"):
        load(write(tmp_path / "cube.ply", text))
    checkered(tmp_path / "paint.png")
    assert look_of(tmp_path / "cube.ply").materials[0].texture is not None


def area(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize("ending", ["obj", "off", "ply"])
@pytest.mark.parametrize("turned", [False, True])
def test_concave_polygons_become_triangles_inside_them(ending, turned, tmp_path):
    outline = [(0, 0, 0), (4, 0, 0), (4, 3, 0), (3, 3, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)]  # a U
    order = range(7, -1, -1) if turned else range(8)
    numbers = " ".join(map(str, order))
    vertices = "".join(f"{x} {y} {z}\n" for x, y, z in outline)
    text = {
        "obj": "".join(f"v {x} {y} {z}\n" for x, y, z in outline) + "f " + " ".join(str(i + 1) for i in order) + "\n",
        "off": f"OFF\n8 1 0\n{vertices}8 {numbers}\n",
        "ply": PLY_HEAD.format("ascii 1.0") + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        + f"{vertices}8 {numbers}\n",
    }[ending]  # fmt: skip
    mesh = load(write(tmp_path / f"u.{ending}", text))
    assert len(mesh.faces) == 6
    assert area(mesh) == pytest.approx(8)
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    assert (np.sign(np.cross(b - a, c - a)[:, 2]) == (-1 if turned else 1)).all()


@pytest.mark.parametrize("letters", [b"caf\xe9", b"\x83e\x83X\x83g", b"\xff\xfe\x00"])
def test_letters_in_no_encoding_and_an_stl_file_in_capitals(letters, tmp_path):
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
