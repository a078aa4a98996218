"""Normals of files without normals: flat or smooth as the file says, else divided at edges of more than 30°."""

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE, Gltf, normals_of, write
from scipy.spatial.transform import Rotation

from dfd.mesh.file.shading import UNSAID, corner_normals
from dfd.mesh.mesh import Mesh, load


def strip(degrees, steps=4):
    """A strip of quads, each turned by an angle against the one before."""
    turns = np.radians(degrees) * np.arange(steps)
    line = np.vstack([np.zeros(2), np.cumsum(np.stack([np.cos(turns), np.sin(turns)], axis=1), axis=0)])
    vertices = np.array([(x, y, z) for x, y in line for z in (0.0, 1.0)])
    faces = [(2 * i, 2 * i + 2, 2 * i + 3) for i in range(steps)] + [
        (2 * i, 2 * i + 3, 2 * i + 1) for i in range(steps)
    ]
    return vertices, np.array(faces)


def least_cosine(path):
    """Return the smallest cosine between the normal of a face corner and the normal of its face."""
    scene = load(path).scene
    found = []
    for each in scene.primitives:
        faces = each.geometry.faces
        a, b, c = (each.vertices[faces[:, corner]] for corner in range(3))
        up = np.cross(b - a, c - a)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        found.append(np.einsum("fi,fci->fc", up, each.normals[faces]).min())
    return float(min(found))


def obj(vertices, faces, said=""):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    return "\n".join([*lines, said, *("f {} {} {}".format(*face) for face in faces + 1), ""])


@pytest.mark.parametrize("ending", ["ply", "stl", "off", "obj"])
@pytest.mark.parametrize(("degrees", "sharp"), [(29, False), (31, True), (90, True)])
def test_an_angle_of_thirty_degrees_divides(ending, degrees, sharp, tmp_path):
    vertices, faces = strip(degrees)
    Mesh(vertices, faces).save(tmp_path / f"a.{ending}")
    load(tmp_path / f"a.{ending}").save(tmp_path / "a.glb")
    least = least_cosine(tmp_path / "a.glb")
    assert (least > 0.9999) == sharp
    if not sharp:
        assert least < np.cos(np.radians(degrees / 4))


@pytest.mark.parametrize("source", ["arrays", "trimesh"])
def test_a_mesh_from_memory_keeps_its_vertices(source, tmp_path):
    mesh = Mesh(CORNERS, CUBE) if source == "arrays" else load(trimesh.Trimesh(CORNERS, CUBE, process=False))
    mesh.save(tmp_path / "a.glb")
    scene = load(tmp_path / "a.glb").scene
    assert np.array_equal(scene.primitives[0].vertices, CORNERS)


@pytest.mark.parametrize("said", ["s off", "s 0", "s null"])
def test_an_obj_that_says_flat_is_flat(said, tmp_path):
    load(write(tmp_path / "a.obj", obj(*strip(10), said))).save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") > 0.9999


def test_an_obj_that_says_smooth_is_smooth_over_sharp_edges(tmp_path):
    load(write(tmp_path / "a.obj", obj(CORNERS, CUBE, "s 1"))).save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") < 0.8


def test_smoothing_groups_of_an_obj_divide(tmp_path):
    vertices, faces = strip(10, steps=2)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    for side in (0, 1):
        lines += [f"s {side + 1}", *("f {} {} {}".format(*face) for face in faces[side::2] + 1)]
    load(write(tmp_path / "a.obj", "\n".join([*lines, ""]))).save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") > 0.9999


def test_a_gltf_file_without_normals_is_flat_in_an_obj_and_back(tmp_path):
    gltf = Gltf()
    vertices, faces = strip(10)
    gltf.node(mesh=gltf.mesh("strip", vertices, faces))
    load(write(tmp_path / "a.glb", gltf.glb())).save(tmp_path / "a.obj")
    load(tmp_path / "a.obj").save(tmp_path / "b.glb")
    assert least_cosine(tmp_path / "b.glb") > 0.9999


def test_a_smooth_shape_keeps_its_vertices(tmp_path):
    vertices, faces = strip(10)
    write(tmp_path / "a.obj", obj(vertices, faces))
    load(tmp_path / "a.obj").save(tmp_path / "a.glb")
    scene = load(tmp_path / "a.glb").scene
    assert len(scene.primitives[0].vertices) == len(vertices)


def test_faces_without_area_and_faces_that_are_wound_otherwise(tmp_path):
    vertices, faces = strip(10)
    sliver = np.vstack([faces, [(2, 2, 3)], [(2, 3, 2)]])
    group, _ = corner_normals(vertices, sliver, np.full(len(sliver), UNSAID))
    assert len(np.unique(group)) == len(vertices)
    turned = faces.copy()
    turned[1::4] = turned[1::4, ::-1]
    Mesh(vertices, turned).save(tmp_path / "a.obj")
    load(tmp_path / "a.obj").save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") > 0.9


SQUARE = np.array([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)], float)


FRONT = np.array([(0, 1, 2), (0, 2, 3)])


def card(folder, ending):
    """A sheet with its own vertices on each side."""
    Mesh(np.vstack([SQUARE, SQUARE]), np.vstack([FRONT, FRONT[:, ::-1] + 4])).save(folder / f"card.{ending}")
    return folder / f"card.{ending}"


@pytest.mark.parametrize("source", ["obj", "ply", "stl", "off", "arrays", "glb"])
def test_both_sides_of_a_sheet_get_the_normals_of_their_faces(source, tmp_path):
    if source == "arrays":
        mesh = Mesh(SQUARE, np.vstack([FRONT, FRONT[:, ::-1]]))
    elif source == "glb":  # the sides share their vertices
        gltf = Gltf()
        gltf.node(mesh=gltf.mesh("card", SQUARE, np.vstack([FRONT, FRONT[:, ::-1]])))
        write(tmp_path / "a.glb", gltf.glb())
        load(tmp_path / "a.glb").save(tmp_path / "a.ply")
        mesh = load(tmp_path / "a.ply")
    else:
        mesh = load(card(tmp_path, source))
    mesh.save(tmp_path / "out.glb")
    scene = load(tmp_path / "out.glb").scene
    (each,) = scene.primitives
    own = each.geometry.faces
    for normals, corners in zip(each.normals[own], each.vertices[own], strict=True):
        across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        assert np.allclose(normals, across / np.linalg.norm(across), atol=1e-6)


def leaf(ending, folder):
    """A folded leaf whose normals all point up, as on foliage."""
    vertices = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 0, 0.2), (1, 1, 0.2)])
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 0, 3), (4, 3, 5)])
    if ending == "obj":
        lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in vertices.tolist()] + ["vn 0 1 0"]
        lines += [f"f {a + 1}//1 {b + 1}//1 {c + 1}//1" for a, b, c in faces.tolist()]
        return write(folder / "leaf.obj", "\n".join(lines) + "\n")
    gltf = Gltf()
    normals = gltf.accessor(np.tile([0.0, 1.0, 0.0], (6, 1)), 5126, "VEC3")
    gltf.node(mesh=gltf.mesh("leaf", vertices, faces, attributes={"NORMAL": normals}))
    return write(folder / "leaf.glb", gltf.glb())


@pytest.mark.parametrize("ending", ["obj", "glb"])
def test_normals_of_an_artist_turn_with_the_surface_and_ignore_other_motions(ending, tmp_path):
    mesh = load(leaf(ending, tmp_path))
    for moved in (mesh.vertices + [0.3, -2.7, 1 / 3], mesh.vertices * 2):
        mesh.save(tmp_path / f"moved.{ending}", moved)
        assert all((each == (0, 1, 0)).all() for each in normals_of(tmp_path / f"moved.{ending}"))
    turn = Rotation.from_rotvec([0.4, -0.7, 1.1])
    mesh.save(tmp_path / f"turned.{ending}", turn.apply(mesh.vertices.copy()))
    for each in normals_of(tmp_path / f"turned.{ending}"):
        assert np.allclose(each, turn.apply([0, 1, 0]), atol=1e-6)
