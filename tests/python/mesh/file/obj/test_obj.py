"""OBJ files: every way to write one reads as it is meant, and saving changes positions and nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import CORNERS, CUBE, bent, checkered, look_of, obj_cube, same_shape, write

from dfd.mesh.file.obj import text as obj_text
from dfd.mesh.mesh import Mesh, load


@pytest.mark.parametrize(
    "change",
    [
        lambda text: b"\xef\xbb\xbf" + text,
        lambda text: text.replace(b"v ", b"\t v\t").replace(b"f ", b"  f \t "),
        lambda text: text.replace(b"\n", b"\r\n"),
        lambda text: text.replace(b"\n", b"\r"),
        lambda text: text.replace(b"\n", b"  # a comment with v 1 2 3\n"),
        lambda text: text.replace(b"f ", b"f \\\n"),
        lambda text: text.rstrip(),
        lambda text: b" " * 100_000 + text,
        lambda text: text.replace(b"f ", b"usemtl " + b"m" * 300 + b"\nf ", 1),
        lambda text: b"# caf\xe9 \x83e\x83X\x83g\no \x83e\x83X\x83g\n" + text,
        lambda text: b"v\nvx 1 2 3\nvp 0 0\nl 1 2\np 1\ns off\ncurv 0 1 1 2\n" + text,
    ],
)
def test_odd_ways_to_write_a_file_read_alike(change, tmp_path):
    mesh = load(write(tmp_path / "cube.obj", change(obj_cube().encode())))
    assert np.array_equal(mesh.vertices, CORNERS)
    assert np.array_equal(mesh.faces, CUBE)


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 3), min_size=3, max_size=12, unique=True), st.data())
def test_parsing_agrees_with_reading_line_by_line(positions, data):
    lines, expected, spaces = [], [], st.sampled_from([" ", "\t", "  "])
    for seen, (x, y, z) in enumerate(positions, 1):
        lines.append(data.draw(st.sampled_from(["v", " v", "\tv"])) + f"{data.draw(spaces)}{x!r} {y!r} {z!r}")
        if seen >= 3:
            corners = data.draw(st.lists(st.integers(0, seen - 1), min_size=3, max_size=5))
            relative = data.draw(st.lists(st.booleans(), min_size=len(corners), max_size=len(corners)))
            words = [str(c - seen) if r else str(c + 1) for c, r in zip(corners, relative, strict=True)]
            lines.append(f"f{data.draw(spaces)}{data.draw(spaces).join(words)}")
            expected.append(corners)
    found = obj_text.parse("\n".join(lines).encode())
    assert np.array_equal(found.positions, np.array(positions))
    assert found.sizes.tolist() == [len(corners) for corners in expected]
    assert found.corners[:, 0].tolist() == [corner for corners in expected for corner in corners]
    for (begin, end), position in zip(found.position_spans, positions, strict=True):
        assert [float(word) for word in found.data[begin:end].split()] == list(position)


# --- saving ---

RICH = """# made by hand
mtllib nowhere.mtl
o body
v 0 0 0
v 1.50 0 0
v 1 1 0   # a corner
v 0 1 0 1.0
v 5 5 5
g left side
s 1
usemtl skin
f 1 2 3 4
usemtl
f -5 -4 -3
o rest
v 0 0 1
v 1 0 1
v 0.5 0.5 1
v 0 1 1
v 0 0 0
f 6 7 8 9 1
f 10 6 7
l 1 2 3
"""


def test_only_positions_change(tmp_path):
    mesh = load_quietly(write(tmp_path / "rich.obj", RICH))
    assert len(mesh.vertices) == 10
    assert mesh.part_names == ("body", "rest")
    mesh.save(tmp_path / "same.obj")
    assert (tmp_path / "same.obj").read_text() == RICH
    moved = mesh.vertices.copy()
    moved[[1, 2, 4]] += 0.25
    mesh.save(tmp_path / "moved.obj", moved)
    expected = RICH.replace("v 1.50 0 0", "v 1.75 0.25 0.25").replace(
        "v 1 1 0   # a corner", "v 1.25 1.25 0.25   # a corner"
    )
    assert (tmp_path / "moved.obj").read_text() == expected.replace("v 5 5 5", "v 5.25 5.25 5.25")
    assert np.array_equal(load_quietly(tmp_path / "moved.obj").vertices, moved)


def load_quietly(path):
    with pytest.warns(UserWarning, match="nowhere.mtl"):
        return load(path)


def test_vertices_at_one_position_stay_together(tmp_path):
    mesh = load_quietly(write(tmp_path / "rich.obj", RICH))
    assert mesh.representative[9] == 0
    moved = mesh.vertices.copy()
    moved[0] = (-1, -1, -1)  # and not vertex 9, which lies there too
    mesh.save(tmp_path / "moved.obj", moved)
    again = load_quietly(tmp_path / "moved.obj")
    assert again.vertices[9].tolist() == [-1, -1, -1]


def test_line_endings_and_strange_letters_stay(tmp_path):
    text = obj_cube().encode().replace(b"\n", b"\r\n") + b"# caf\xe9\r\no \x83e\r\n"
    mesh = load(write(tmp_path / "cube.obj", text))
    mesh.save(tmp_path / "out.obj", CORNERS * 2)
    lines = (tmp_path / "out.obj").read_bytes().split(b"\r\n")
    assert lines[7] == b"v 2.0 2.0 2.0"
    assert lines[-3:] == [b"# caf\xe9", b"o \x83e", b""]


def cube_with_shared_normals():
    """A cube of quads, one normal a side, each side named by four corners; relative numbers on the last side."""
    sides = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    normals = [(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)]
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in CORNERS] + ["vn {} {} {}".format(*each) for each in normals]
    lines += ["f " + " ".join(f"{corner}//{side + 1}" for corner in corners) for side, corners in enumerate(sides[:5])]
    lines.append("f " + " ".join(f"{corner - 9}//-1" for corner in sides[5]))
    return "\n".join(lines) + "\n"


def test_normals_turn_with_the_surface_and_stay_shared(tmp_path):
    mesh = load(write(tmp_path / "cube.obj", cube_with_shared_normals()))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mesh.save(tmp_path / "turned.obj", mesh.vertices @ turn.T)
    found = obj_text.parse((tmp_path / "turned.obj").read_bytes())
    before = obj_text.parse(cube_with_shared_normals().encode())
    assert np.allclose(found.normals, before.normals @ turn.T)
    assert np.array_equal(found.corners, before.corners)
    assert (tmp_path / "turned.obj").read_text().splitlines()[14:] == cube_with_shared_normals().splitlines()[14:]


@pytest.mark.parametrize("late", [False, True])
def test_corners_that_share_a_normal_no_longer_get_their_own(late, tmp_path):
    text = cube_with_shared_normals()
    if late:  # a second part, whose normals come after the faces of the first
        text += "o second\nv 9 0 0\nv 9 1 0\nv 9 0 1\nvn 0 0 -1\nf 9//7 10//7 11//-1\n"
    mesh = load(write(tmp_path / "cube.obj", text))
    moved = mesh.vertices.copy()
    moved[7] += (0.5, 0.5, 0.5)
    mesh.save(tmp_path / "pulled.obj", moved)
    found = obj_text.parse((tmp_path / "pulled.obj").read_bytes())
    assert np.array_equal(found.positions, moved)
    assert np.array_equal(found.sizes, obj_text.parse(text.encode()).sizes)
    again = load(tmp_path / "pulled.obj")
    assert same_shape(again, Mesh(moved, mesh.faces))
    for each, corners in zip(
        np.split(found.corners, np.cumsum(found.sizes)[:-1]), range(len(found.sizes)), strict=True
    ):
        normals = found.normals[each[:, 2]]
        if 7 not in each[:, 0] or corners >= 6:  # nothing of it has moved
            assert np.ptp(normals, axis=0).max() == 0
        else:
            assert np.allclose(np.linalg.norm(normals, axis=1), 1)
            assert np.ptp(normals, axis=0).max() > 0.01  # the side is bent now
    if late:
        assert found.normals[found.corners[-1, 2]].tolist() == [0, 0, -1]


def test_materials_are_those_that_are_used_and_pictures_may_have_options(tmp_path):
    checkered(tmp_path / "my paint.png")
    write(
        tmp_path / "a.mtl",
        "newmtl unused\nmap_Kd absent.png\nnewmtl shown\nKd 1 0 0\nmap_Kd -s 1 1 1 -clamp on my paint.png\n",
    )
    write(tmp_path / "b.mtl", "newmtl other\nKd 0 1 0\n")
    text = "mtllib a.mtl b.mtl\nvt 0 0\n" + obj_cube().replace("f ", "usemtl shown\nf ", 1) + "usemtl other\nf 1 2 3\n"
    look = look_of(write(tmp_path / "cube.obj", text))
    assert look.materials[0].texture is not None
    assert look.materials[1].color == (0.0, 1.0, 0.0, 1.0)


def test_groups_are_parts_where_objects_are_not(tmp_path):
    text = "o whole\n" + obj_cube().replace("f ", "g wheel\nf ", 1) + "g body\nf 1 2 3\ng wheel\nf 2 3 4\n"
    mesh = load(write(tmp_path / "groups.obj", text))
    assert mesh.part_names == ("wheel", "body")
    assert [part.faces for part in mesh.parts] == [slice(0, 13), slice(13, 14)]


FACES = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in CUBE.tolist())


@pytest.mark.parametrize(
    ("names", "mtl"),
    [
        ([b"\xbd\xf0\xca\xf4", b"\xb2\xc4\xd6\xca"], b""),
        ([b"\xc3\xa3", b"Gr\xfcn"], b""),
        (["材质".encode(), "木".encode()], b"# cr\xe9\xe9\n"),
        ([b"a\x85b", b"c\xa0d"], b""),
        ([b"red", b"blue"], b"\xef\xbb\xbf"),
    ],
)
def test_materials_are_found_by_their_bytes_and_keep_them(names, mtl, tmp_path):
    first, second = names
    write(tmp_path / "a.mtl", mtl + b"newmtl %s\nKd 1 0 0\nnewmtl %s\nKd 0 0 1\n" % (first, second))
    head = b"mtllib a.mtl\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS).encode()
    lines = FACES.encode().splitlines(keepends=True)
    text = head + b"usemtl %s\n" % first + b"".join(lines[:6]) + b"usemtl %s\n" % second + b"".join(lines[6:])
    mesh = load(write(tmp_path / "a.obj", text))
    (tmp_path / "other").mkdir()
    mesh.save(tmp_path / "other" / "a.obj", mesh.vertices * 2)
    for each in (mesh, load(tmp_path / "other" / "a.obj")):
        colors = [material.color[:3] for material in look_of(each).materials]
        assert colors == [(1, 0, 0), (0, 0, 1)]
    copied = (tmp_path / "other" / "a.mtl").read_bytes()
    assert all(b"newmtl %s\n" % name in copied for name in names)


def test_a_material_is_found_in_a_library_of_another_encoding(tmp_path):
    write(tmp_path / "a.mtl", "newmtl Grün\nKd 1 0 0\n".encode("latin-1"))
    mesh = load(write(tmp_path / "a.obj", "mtllib a.mtl\nusemtl Grün\n" + obj_cube()))
    assert look_of(mesh).materials[0].color[:3] == (1, 0, 0)
    (tmp_path / "other").mkdir()
    mesh.save(tmp_path / "other" / "a.obj")
    assert look_of(tmp_path / "other" / "a.obj").materials[0].name == "Grün"


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b""])
@pytest.mark.parametrize("line_break", [b"\n", b"\r\n", b"\r"])
def test_an_obj_keeps_its_mark_and_its_continued_lines(mark, line_break, tmp_path):
    text = mark + obj_cube().replace("f 1 2 4", "f 1 \\\n2 4").encode().replace(b"\n", line_break)
    if line_break == b"\r":
        text = mark + obj_cube().encode().replace(b"\n", line_break)
    mesh = load(write(tmp_path / "a.obj", text))
    mesh.save(tmp_path / "same.obj")
    assert (tmp_path / "same.obj").read_bytes() == text
    mesh.save(tmp_path / "moved.obj", bent(mesh.vertices))
    assert np.array_equal(load(tmp_path / "moved.obj").vertices, bent(mesh.vertices))
