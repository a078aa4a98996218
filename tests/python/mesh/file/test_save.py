"""Writing: what a round trip through a file keeps, and what happens when it fails."""

import resource

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE, Gltf, look_of, painted_cube, same_shape, scene_of_three, textured_quad, write

from dfd.mesh.mesh import Mesh, load

FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf")


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("moved", [False, True])
def test_a_mesh_from_arrays_comes_back_from_every_format(ending, moved, tmp_path):
    mesh = Mesh(CORNERS, CUBE)
    vertices = CORNERS * [1, 2, 3] + 5 if moved else None
    path = tmp_path / f"cube.{ending}"
    mesh.save(path, vertices)
    assert same_shape(load(path), Mesh(CORNERS if vertices is None else vertices, CUBE))
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", ["glb", "gltf", "obj"])
def test_a_scene_keeps_parts_materials_and_colors(ending, tmp_path):
    mesh = load(scene_of_three(tmp_path))
    mesh.save(tmp_path / f"out.{ending}")
    again = load(tmp_path / f"out.{ending}")
    assert same_shape(mesh, again)
    assert again.part_names == mesh.part_names == ("square", "near", "far")
    faces, middle = np.arange(len(mesh.faces)), np.full((len(mesh.faces), 3), 1 / 3, np.float32)
    before, after = look_of(mesh).albedo(faces, middle), look_of(again).albedo(faces, middle)
    assert np.abs(before - after).max() < 0.01


def test_instances_that_move_apart_are_split_and_those_that_rest_are_not(tmp_path):
    mesh = load(scene_of_three(tmp_path))
    mesh.save(tmp_path / "same.glb")
    assert len(trimesh.load_scene(tmp_path / "same.glb").geometry) == 2
    vertices = mesh.vertices.copy()
    far = vertices[:, 2] < -4
    vertices[far] += [0, 7, 0]
    mesh.save(tmp_path / "moved.glb", vertices)
    scene = trimesh.load_scene(tmp_path / "moved.glb")
    assert len(scene.geometry) == 3
    assert same_shape(load(tmp_path / "moved.glb"), Mesh(vertices, mesh.faces), 1e-5)
    # the nodes stand where they stood
    original = trimesh.load_scene(tmp_path / "three.glb")
    for node in ("near", "far", "square"):
        assert np.allclose(scene.graph[node][0], original.graph[node][0])


def test_a_seam_stays_closed_and_keeps_both_its_texture_coordinates(tmp_path):
    text = "\n".join(
        ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 1 1 0", "vt 0 0", "vt 1 0", "vt 0 1", "vt 0.5 0.5", "vt 0.25 0.75"]
        + ["f 1/1 2/2 3/3", "f 2/4 4/5 3/1"]
    )
    mesh = load(write(tmp_path / "seam.obj", text))
    assert len(mesh.vertices) == 4
    vertices = mesh.vertices + [[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3]]
    mesh.save(tmp_path / "out.obj", vertices)
    mesh.save(tmp_path / "out.glb", vertices)
    for name in ("out.obj", "out.glb"):
        assert same_shape(load(tmp_path / name), Mesh(vertices, mesh.faces))
        geometry = next(iter(trimesh.load_scene(tmp_path / name, process=False).geometry.values()))
        assert len(geometry.vertices) == 6
        corner_uv = np.asarray(geometry.visual.uv)[geometry.faces]
        assert np.allclose(corner_uv[0], [(0, 0), (1, 0), (0, 1)])
        assert np.allclose(corner_uv[1], [(0.5, 0.5), (0.25, 0.75), (0, 0)])
    lines = (tmp_path / "out.obj").read_text().splitlines()
    assert sum(line.startswith("v ") for line in lines) == 4


def test_a_mirrored_placing_keeps_normals_outside(tmp_path):
    gltf = Gltf()
    normals = gltf.accessor((CORNERS - 0.5) / np.sqrt(0.75), 5126, "VEC3")
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE, attributes={"NORMAL": normals}), scale=[-1, 1, 1])
    mesh = load(write(tmp_path / "mirrored.glb", gltf.glb()))
    mesh.save(tmp_path / "out.glb", mesh.vertices * 2)
    geometry = next(iter(trimesh.load_scene(tmp_path / "out.glb", process=False).geometry.values()))
    outward = geometry.vertices - geometry.vertices.mean(axis=0)
    assert np.all(np.einsum("ij,ij->i", geometry.vertex_normals, outward) > 0)


@pytest.mark.parametrize("outside", [True, False])
def test_normals_keep_their_side_whichever_way_faces_are_wound(tmp_path, outside):
    """The faces are wound inwards. Moved normals stay on the side on which the file has them."""
    gltf, sign = Gltf(), 1.0 if outside else -1.0
    normals = gltf.accessor(sign * (CORNERS - 0.5) / np.sqrt(0.75), 5126, "VEC3")
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE[:, ::-1], attributes={"NORMAL": normals}))
    mesh = load(write(tmp_path / "cube.glb", gltf.glb()))
    mesh.save(tmp_path / "out.glb", mesh.vertices * 2)
    geometry = next(iter(trimesh.load_scene(tmp_path / "out.glb", process=False).geometry.values()))
    outward = geometry.vertices - geometry.vertices.mean(axis=0)
    assert np.all(sign * np.einsum("ij,ij->i", geometry.vertex_normals, outward) > 0)


def test_textures_become_vertex_colors_in_ply(tmp_path):
    mesh = load(write(tmp_path / "quad.glb", textured_quad(tmp_path).glb()))
    mesh.save(tmp_path / "quad.ply")
    corners = look_of(tmp_path / "quad.ply").albedo(np.zeros(3, int), np.eye(3))
    assert np.allclose(corners, look_of(mesh).albedo(np.zeros(3, int), np.eye(3)), atol=0.01)


def test_saving_an_obj_overwrites_no_other_files_texture(tmp_path):
    mesh = load(painted_cube(tmp_path))
    original = (tmp_path / "paint.png").read_bytes()
    mesh.save(tmp_path / "out.obj", mesh.vertices * 2)
    assert (tmp_path / "paint.png").read_bytes() == original
    assert look_of(tmp_path / "out.obj")
    # elsewhere it takes its materials along, past whatever else is there
    other = tmp_path / "other"
    other.mkdir()
    write(other / "paint.png", "mine")
    mesh.save(other / "out.obj", mesh.vertices * 2)
    assert (other / "paint.png").read_bytes() == b"mine"
    assert {path.name for path in other.iterdir()} == {"out.obj", "out.mtl", "paint.png", "paint_2.png"}
    look = look_of(other / "out.obj")
    assert np.array_equal(look.materials[0].texture, look_of(mesh).materials[0].texture)


def test_saving_refuses_what_it_cannot_write(tmp_path):
    mesh = Mesh(CORNERS, CUBE)
    with pytest.raises(ValueError, match=r"Mesh.save: `path` must end in .*, got .*cube.txt"):
        mesh.save(tmp_path / "cube.txt")
    with pytest.raises(ValueError, match=r"Mesh.save: `vertices` must have shape \(8, 3\), got \(7, 3\)"):
        mesh.save(tmp_path / "cube.obj", CORNERS[:7])
    with pytest.raises(ValueError, match="Mesh.save: `vertices` must be finite"):
        mesh.save(tmp_path / "cube.obj", CORNERS + np.inf)
    with pytest.raises(FileNotFoundError, match="the folder .* does not exist"):
        mesh.save(tmp_path / "absent" / "cube.obj")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", ["stl", "glb", "gltf"])
def test_coordinates_that_a_format_cannot_hold_are_refused(ending, tmp_path):
    with pytest.raises(ValueError, match=f"must fit in 32-bit floats for a .{ending} file"):
        Mesh(CORNERS, CUBE).save(tmp_path / f"cube.{ending}", CORNERS * 1e39)
    assert not list(tmp_path.iterdir())
    Mesh(CORNERS, CUBE).save(tmp_path / "cube.OFF", CORNERS * 1e39)
    assert load(tmp_path / "cube.OFF").extents[0] == 1e39


def test_a_scene_is_written_whole_or_not_at_all(tmp_path):
    mesh = load(scene_of_three(tmp_path))
    out = tmp_path / "out"
    out.mkdir()
    mesh.save(out / "scene.OBJ")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert set(before) == {"scene.OBJ", "scene.mtl", "scene_paint.png"}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before["scene.OBJ"]) - 1, limits[1]))
    try:
        with pytest.raises(OSError, match="scene.OBJ could not be written: File too large") as caught:
            mesh.save(out / "scene.OBJ")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert str(caught.value).count("could not be written") == 1
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
