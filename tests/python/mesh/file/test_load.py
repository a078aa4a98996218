"""Reading: what every format gives, and what is refused with one sentence."""

import re

import pytest
import trimesh
from mesh_files import CORNERS, CUBE, Gltf, obj_cube, same_shape, write

from dfd.mesh.mesh import Mesh, load

FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf")


@pytest.mark.parametrize("ending", FORMATS)
def test_a_plain_cube_is_read_from_every_format(ending, tmp_path):
    path = tmp_path / f"cube.{ending}"
    trimesh.Scene(trimesh.Trimesh(CORNERS, CUBE, process=False)).export(path) if ending != "off" else trimesh.Trimesh(
        CORNERS, CUBE, process=False
    ).export(path)
    mesh = load(path)
    assert mesh.vertices.shape == (8, 3)
    assert same_shape(mesh, Mesh(CORNERS, CUBE))
    assert mesh.source == path
    assert repr(mesh) == f"Mesh(cube.{ending}: 8 vertices, 12 faces)"


def test_obj_vertices_keep_the_files_numbers_across_parts_seams_and_unused_ones(tmp_path):
    text = """
        v 0 0 0
        v 1 0 0
        v 9 9 9
        v 0 1 0
        v 0 0 1
        v 1 0 0
        vt 0 0
        vt 1 0
        vt 0 1
        o later
        usemtl b
        f 4/1 5/2 6/3
        o sooner
        usemtl a
        f 1/1 2/2 4/3
        f 1/2 4/1 2/3
    """
    mesh = load(write(tmp_path / "parts.obj", "\n".join(line.strip() for line in text.splitlines())))
    # vertex 3 (9 9 9) is used by no face, vertex 6 lies where vertex 2 does
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [9, 9, 9], [0, 1, 0], [0, 0, 1], [1, 0, 0]]
    assert mesh.faces.tolist() == [[3, 4, 1], [0, 1, 3], [0, 3, 1]]
    assert mesh.representative.tolist() == [0, 1, 2, 3, 4, 1]
    assert mesh.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]  # of what can be seen
    assert mesh.normals[2].tolist() == [0, 0, 0]
    assert Mesh(mesh.vertices, mesh.faces).bounds.max() == 9  # all vertices of arrays count
    assert mesh.part_names == ("later", "sooner")
    assert [part.faces for part in mesh.parts] == [slice(0, 1), slice(1, 3)]
    assert mesh.part_vertices("later").tolist() == [1, 3, 4]


def test_parts_that_touch_share_their_vertices(tmp_path):
    gltf = Gltf()
    for name, offset in (("left", 0), ("right", 1)):
        gltf.node(name=name, mesh=gltf.mesh(name, CORNERS + [offset, 0, 0], CUBE))
    assert len(load(write(tmp_path / "touching.glb", gltf.glb())).vertices) == 12


def reads(path):
    with pytest.raises((ValueError, OSError)) as caught:
        load(path)
    message = str(caught.value)
    assert "load: `path`" in message
    assert str(path) in message
    assert "\n" not in message
    return message


PLY = "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.obj", "", "is empty"),
        ("words.obj", "once upon a time\n", "holds no faces|not a well-formed"),
        ("list.gltf", "[1, 2]", "its JSON is a list"),
        ("words.gltf", "once upon a time\n", "begins neither with glTF, as a GLB file does, nor with a JSON object"),
        ("junk.glb", b"\xa5\x9f\x00\xff", "begins neither with glTF, as a GLB file does, nor with a JSON object"),
        ("cut.gltf", '{"asset": {}', "its JSON text is damaged at character 12: Expecting ',' delimiter"),
        ("byte.gltf", b'{"asset": \xff}', "its JSON text is damaged at byte 10, which is not UTF-8"),
        ("one.obj", "v 0 0 0\nf 1 1 1\n", "at least 3 distinct vertices, got 1"),
        ("nan.obj", obj_cube().replace("v 0 0 0", "v 0 nan 0"), "must hold finite coordinates, got nan at vertex 0"),
        ("zero.obj", obj_cube() + "f 0 1 2\n", "a face names vertex 0, but the first is 1"),
        ("word.obj", obj_cube() + "f 1 two 3\n", "line 21: the corner 'two' of a face must consist of whole numbers"),
        ("short.obj", obj_cube() + "v 1 0\n", "line 21: 'v' has 2 numbers, and 3 are needed"),
        ("cube.xyz", obj_cube(), "must end in .obj, .ply, .stl, .off, .glb, .gltf"),
        ("face.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n-1 0 1\n", "face 0 has '-1' corners"),
        ("counts.off", "OFF 3\n0 0 0\n1 0 0\n0 1 0\n", "it must state its numbers of vertices and faces, got '3'"),
        ("one.off", "OFF\n3 1\n0 0 0\n1 0 0\n5\n3 0 1 2\n", "vertex 2 has the coordinates '5'"),
        ("cut.ply", PLY.format(n=3) + "end_header\n0 0 0\n1 0 0\n", "before the end of its 3 rows of 'vertex'"),
        ("cut.stl", "x" * 80 + "\x0c\0\0\0" + "x" * 100, "it should have 12 faces in 684 bytes, but has 184 bytes"),
        ("facet.stl", "solid\nfacet normal 0 0 0\n", "it is cut off: it begins 1 faces, ends 0"),
    ],
)
def test_malformed_files_get_one_sentence(name, content, message, tmp_path):
    found = reads(write(tmp_path / name, content))
    assert re.search(message, found), found


def test_files_that_cannot_be_opened(tmp_path):
    with pytest.raises(FileNotFoundError, match="could not be read: No such file"):
        load(tmp_path / "absent.obj")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(OSError, match="it is not a file"):
        load(tmp_path / "folder.obj")


def nested(depth):
    return [nested(depth - 1)] if depth else []


def break_header(change):
    gltf = Gltf()
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE))
    change(gltf.header)
    return gltf.glb()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: h["accessors"][0].update(count=2_000_000_000), "accessor 0 has 2000000000 items up to byte"),
        (lambda h: h["accessors"][0].update(bufferView=7), "accessor 0 names bufferView 7, but there are 2"),
        (lambda h: h["accessors"][0].update(componentType=1), "accessor 0 has the unknown componentType 1"),
        (lambda h: h["accessors"][0].pop("bufferView"), "must hold at least 3 distinct vertices, got 1"),
        (lambda h: h["accessors"].append({"count": 2**33, "componentType": 5126, "type": "MAT4"}), "but no data"),
        (lambda h: h["bufferViews"][0].update(byteLength=10**9), "bufferView 0 ends at byte"),
        (lambda h: h["meshes"][0]["primitives"][0].update(indices=9), "names accessor 9 for its indices"),
        (lambda h: h["nodes"][0].update(children=[0]), "its nodes are their own ancestors"),
        (lambda h: h["nodes"].extend({"children": [0]} for _ in range(2)), "node 0 is the child of more than one"),
        (
            lambda h: (h["nodes"].extend({"children": [i]} for i in range(2000)), h["scenes"][0].update(nodes=[2000])),
            "nested more than 1000 deep",
        ),
        (lambda h: h["nodes"][0].update(scale=[1e308, 1, 1], translation=[1e308, 0, 0]), "finite"),
        (
            lambda h: h.update(extensionsRequired=["EXT_magic"]),
            "'EXT_magic', which cannot be read: export the file without",
        ),
        (lambda h: h.update(extras=nested(900)), "its values are nested more than 200 deep"),
    ],
)
def test_headers_that_cannot_be_right_are_refused(change, message, tmp_path):
    found = reads(write(tmp_path / "broken.glb", break_header(change)))
    assert message in found
    assert len(found) < 400
