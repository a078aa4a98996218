"""One missing value of an attribute does not discard the others: in every format, it is filled or computed."""

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, bent, checkered, look_of, ply, write
from scipy.spatial.transform import Rotation

from dfd.mesh.mesh import load

TURN = Rotation.from_rotvec([0, 0, np.pi / 2])
RED = "1 0 0"


def obj(vertices, faces):
    return "\n".join([*(f"v {each}" for each in vertices), *(f"f {each}" for each in faces), ""])


def places():
    return [f"{x:g} {y:g} {z:g}" for x, y, z in CORNERS.tolist()]


def triangles(offset=0):
    return ["{} {} {}".format(*(face + offset)) for face in CUBE]


def obj_with_normals(without):
    """A cube with the normals of its sides, and one face without normals."""
    normals = ["vn 1 0 0", "vn -1 0 0", "vn 0 1 0", "vn 0 -1 0", "vn 0 0 1", "vn 0 0 -1"]
    faces = []
    for number, face in enumerate(CUBE):
        up = np.cross(CORNERS[face[1]] - CORNERS[face[0]], CORNERS[face[2]] - CORNERS[face[0]])
        axis = int(np.abs(up).argmax())
        index = 2 * axis + (1 if up[axis] > 0 else 2)
        corners = (f"{corner + 1}" if number == without else f"{corner + 1}//{index}" for corner in face)
        faces.append(f"f {' '.join(corners)}")
    return "\n".join([*(f"v {each}" for each in places()), *normals, *faces, ""])


def corners_and_sides(path):
    """Return the normals (F, 3, 3) of face corners of the only primitive, NaN if missing, and those of the faces."""
    mesh = load(path)
    (each,) = mesh.scene.primitives
    normals = np.full(each.vertices.shape, np.nan) if each.normals is None else each.normals
    a, b, c = (each.vertices[each.geometry.faces[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    return normals[each.geometry.faces], across / np.linalg.norm(across, axis=1, keepdims=True)


@pytest.mark.parametrize("without", [0, 7])
def test_given_normals_turn_and_a_missing_one_is_computed(without, tmp_path):
    mesh = load(write(tmp_path / "a.obj", obj_with_normals(without)))
    for ending in ("obj", "glb"):
        mesh.save(tmp_path / f"turned.{ending}", TURN.apply(mesh.vertices.copy()))
        normals, sides = corners_and_sides(tmp_path / f"turned.{ending}")
        known = np.isfinite(normals).all(axis=(1, 2))
        assert known.sum() == (11 if ending == "obj" else 12)
        assert np.allclose(normals[known], sides[known, None], atol=1e-6)


def test_a_missing_normal_is_smooth_in_a_ply_file(tmp_path):
    load(write(tmp_path / "a.obj", obj_with_normals(7))).save(tmp_path / "a.ply")
    mesh = load(tmp_path / "a.ply")
    (each,) = mesh.scene.primitives
    outwards = np.abs(each.normals) @ np.ones(3)
    assert np.allclose(np.linalg.norm(each.normals, axis=1), 1, atol=1e-6)
    filled = ~np.isclose(outwards, 1, atol=1e-6)  # at a corner of the cube, no smooth normal is along an axis
    assert filled.sum() == 3
    centers = each.vertices - CORNERS.mean(axis=0)
    assert (np.einsum("nk,nk->n", each.normals, centers)[filled] > 0).all()


def colored(ending):
    """A red cube whose last vertex, or last face, has no color."""
    rows = [f"{place} {RED}" for place in places()]
    if ending == "obj":
        return obj([*rows[:-1], places()[-1]], triangles(1))
    if ending == "ply":
        colors = ["float red", "float green", "float blue"]
        return ply(colors, [*rows[:-1], f"{places()[-1]} nan 0 0"], faces=[f"3 {each}" for each in triangles()])
    if ending == "off":
        return "\n".join(["COFF", "8 12 0", *rows[:-1], f"{places()[-1]} nan nan nan"] + [
            f"3 {each}" for each in triangles()] + [""])  # fmt: skip
    gltf = Gltf()
    colors = np.tile(np.array([1, 0, 0], np.float32), (8, 1))
    colors[-1] = np.nan
    color = gltf.accessor(colors, 5126, "VEC3")
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE, attributes={"COLOR_0": color}))
    return gltf.glb()


@pytest.mark.parametrize("ending", ["obj", "ply", "off", "glb"])
def test_one_vertex_without_a_color_is_white_and_said(ending, tmp_path):
    path = write(tmp_path / f"a.{ending}", colored(ending))
    with pytest.warns(UserWarning, match=r"has 1 vertex without a color: white is used") as said:
        mesh = load(path)
    assert len(said) == 1
    assert np.allclose(mesh.vertex_colors()[:7], (1, 0, 0, 1))
    assert np.allclose(mesh.vertex_colors()[7], 1)


def test_an_unused_vertex_without_a_color_is_not_said(tmp_path):
    mesh = load(write(tmp_path / "a.obj", obj([*(f"{each} {RED}" for each in places()), "9 9 9"], triangles(1))))
    assert np.allclose(mesh.vertex_colors()[:8], (1, 0, 0, 1))


def test_faces_without_a_color_are_white_and_said(tmp_path):
    rows = [f"3 {each}{f' {RED}' if index else ''}" for index, each in enumerate(triangles())]
    path = write(tmp_path / "a.off", "\n".join(["OFF", "8 12 0", *places(), *rows, ""]))
    with pytest.warns(UserWarning, match=r"has 1 face without a color: white is used"):
        look = look_of(path)
    middle = np.full((12, 3), 1 / 3, np.float32)
    assert np.allclose(look.albedo(np.arange(12), middle)[1:], (1, 0, 0, 1))


def test_colors_of_a_gltf_file_with_too_few_rows_are_kept(tmp_path):
    gltf = Gltf()
    color = gltf.accessor(np.tile(np.array([255, 0, 0, 255], np.uint8), (7, 1)), 5121, "VEC4")
    gltf.header["accessors"][color]["normalized"] = True
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE, attributes={"COLOR_0": color}))
    path = write(tmp_path / "a.glb", gltf.glb())
    with pytest.warns(UserWarning, match="1 vertex without a color"):
        assert np.allclose(load(path).vertex_colors()[:7], (1, 0, 0, 1))


def test_one_face_without_texture_coordinates_leaves_those_of_the_others(tmp_path):
    checkered(tmp_path / "paint.png", 64)
    write(tmp_path / "a.mtl", "newmtl m\nmap_Kd paint.png\n")
    quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
    path = write(tmp_path / "a.obj", f"mtllib a.mtl\n{quad}usemtl m\nf 1/1 2/2 3/3\nf 1 3 4\n")
    with pytest.warns(UserWarning, match="has 3 textured vertices without coordinates: 0 is used"):
        look = look_of(path)
    assert np.allclose(look.albedo(np.array([0]), np.array([(0.1, 0.8, 0.1)])), (1, 1, 1, 1), atol=0.01)


def test_one_face_of_a_ply_without_texture_coordinates_leaves_those_of_the_others(tmp_path):
    checkered(tmp_path / "paint.png", 64)
    rows, faces = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"], ["3 0 1 2 6 0 0 1 0 1 1", "3 0 2 3 0"]
    text = ply([], rows, faces=faces, of_faces=["list uchar float texcoord"], comment="TextureFile paint.png")
    path = write(tmp_path / "a.ply", text)
    with pytest.warns(UserWarning, match="textured vertices without coordinates"):
        look = look_of(path)
    assert np.allclose(look.albedo(np.array([0]), np.array([(0.1, 0.8, 0.1)])), (1, 1, 1, 1), atol=0.01)


@pytest.mark.parametrize("ending", ["obj", "ply", "off", "glb"])
@pytest.mark.parametrize("where", [0, 8])
def test_a_vertex_without_a_position_that_no_face_uses_follows_nothing(ending, where, tmp_path):
    vertices, faces = np.insert(CORNERS, where, np.nan, axis=0), CUBE + (where == 0)
    rows = [" ".join(f"{each:g}" for each in row) for row in vertices.tolist()]
    text = {
        "obj": "".join(f"v {row}\n" for row in rows) + "".join("f {} {} {}\n".format(*each) for each in faces + 1),
        "ply": ply([], rows, faces=["3 {} {} {}".format(*each) for each in faces]),
        "off": "\n".join(["OFF", "9 12 0", *rows, *("3 {} {} {}".format(*each) for each in faces), ""]),
    }
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", vertices, faces))
    mesh = load(write(tmp_path / f"a.{ending}", text.get(ending, "").encode() or gltf.glb()))
    moved = bent(mesh.vertices) + 0.1
    mesh.save(tmp_path / f"moved.{ending}", moved)
    again = load(tmp_path / f"moved.{ending}")
    assert np.allclose(again.vertices[again.faces], moved[mesh.faces], rtol=0, atol=1e-6)
    if ending in text:
        assert (tmp_path / f"moved.{ending}").read_text().count("nan") == 3
        assert (mesh.vertices[where] == 0).all()
        assert mesh.representative[where] == where
    mesh.save(tmp_path / "other.glb", moved)
    assert b"NaN" not in (tmp_path / "other.glb").read_bytes()
