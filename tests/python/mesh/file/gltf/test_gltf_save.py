"""glTF files are patched, not written anew."""

import struct

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE, Gltf, bent, header_and_data, same_shape, textured_quad, view_bytes, write

from dfd.mesh.mesh import Mesh, load


def test_everything_but_positions_survives_in_a_glb(tmp_path):
    gltf = textured_quad(tmp_path)
    inverse = gltf.accessor([np.eye(4).ravel()], 5126, "MAT4")
    times, turns = gltf.accessor([[0.0], [1.0]], 5126, "SCALAR"), gltf.accessor([(0, 0, 0, 1)] * 2, 5126, "VEC4")
    bone = gltf.node(name="bone")
    kept = {
        "skins": [{"joints": [bone], "inverseBindMatrices": inverse}],
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": bone, "path": "rotation"}}],
                "samplers": [{"input": times, "output": turns}],
            }
        ],
        "samplers": [{"wrapS": 33071}],
        "extras": {"author": "somebody"},
    }
    gltf.header |= kept
    gltf.header["nodes"][0]["skin"] = 0
    gltf.header["materials"][0] |= {"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}
    path = write(tmp_path / "skinned.glb", gltf.glb())
    mesh = load(path)
    mesh.save(tmp_path / "out.glb", mesh.vertices * 2)
    before, _ = header_and_data(path)
    after, _ = header_and_data(tmp_path / "out.glb")
    for name in (*kept, "materials", "textures", "images", "nodes", "scenes"):
        assert after[name] == before[name]
    picture = before["images"][0]["bufferView"]
    assert view_bytes(tmp_path / "out.glb", picture) == (tmp_path / "paint.png").read_bytes()
    assert np.array_equal(load(tmp_path / "out.glb").vertices, mesh.vertices * 2)


def test_primitives_that_share_positions_move_together(tmp_path):
    gltf = Gltf()
    mesh_index = gltf.mesh("cube", CORNERS, CUBE[:6])
    primitives = gltf.header["meshes"][mesh_index]["primitives"]
    rest = gltf.accessor(CUBE[6:].ravel(), 5125, "SCALAR")
    primitives.append({"attributes": dict(primitives[0]["attributes"]), "indices": rest})
    gltf.node(name="cube", mesh=mesh_index, translation=[1, 2, 3])
    mesh = load(write(tmp_path / "shared.glb", gltf.glb()))
    assert (len(mesh.vertices), mesh.part_names) == (8, ("cube",))
    mesh.save(tmp_path / "out.glb", mesh.vertices[::-1])
    again = load(tmp_path / "out.glb")
    assert same_shape(again, Mesh(mesh.vertices[::-1], mesh.faces))
    primitives = header_and_data(tmp_path / "out.glb")[0]["meshes"][0]["primitives"]
    assert primitives[0]["attributes"] == primitives[1]["attributes"]


def test_a_scene_without_normals_gets_smooth_ones(tmp_path):
    sphere = trimesh.creation.icosphere(2)
    lines = [f"v {x} {y} {z}" for x, y, z in sphere.vertices]
    faces = [f"f {a} {b} {c}" for a, b, c in sphere.faces + 1]
    half = len(faces) // 2
    (tmp_path / "ball.obj").write_text("\n".join([*lines, "usemtl red", *faces[:half], "usemtl blue", *faces[half:]]))
    mesh = load(tmp_path / "ball.obj")
    mesh.save(tmp_path / "ball.glb", mesh.vertices * 2)
    for each in trimesh.load_scene(tmp_path / "ball.glb", process=False).geometry.values():
        along = np.einsum("nk,nk->n", each.vertex_normals, each.vertices / 2)
        assert along.min() > 0.99, "also where the materials meet"


@pytest.mark.parametrize(
    "node", [{"scale": [1, 0, 1]}, {"scale": [0, 0, 0]}, {"matrix": [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]
)
@pytest.mark.parametrize("child", [False, True])
def test_an_edit_of_a_flattened_part_is_saved(node, child, tmp_path):
    gltf = Gltf()
    cube = gltf.mesh("cube", CORNERS, CUBE)
    gltf.node(name="shadow", mesh=cube, **node)
    gltf.node(name="body", mesh=cube, translation=[0, 1, 0])
    if child:
        gltf.header["nodes"][0]["children"] = [2]
        gltf.header["nodes"].append({"name": "below", "mesh": cube})
    mesh = load(write(tmp_path / "flat.glb", gltf.glb()))
    moved = bent(mesh.vertices)
    for ending in ("glb", "gltf", "obj"):
        mesh.save(tmp_path / f"out.{ending}", moved)
        again = load(tmp_path / f"out.{ending}")
        assert sorted(again.part_names) == sorted(mesh.part_names)
        for name in mesh.part_names:
            found, wanted = (
                np.unique(np.round(values[shape.part_vertices(name)], 5), axis=0)
                for shape, values in ((again, again.vertices), (mesh, moved))
            )
            assert np.allclose(found, wanted, atol=2e-5), (ending, name)


@pytest.mark.parametrize("required", [False, True])
def test_instances_of_a_node_are_parts_that_move_by_themselves(required, tmp_path):
    gltf = Gltf()
    cube = gltf.mesh("cube", CORNERS, CUBE)
    half = float(np.sqrt(0.5))
    attributes = {
        "TRANSLATION": gltf.accessor([(0, 0, 0), (3, 0, 0), (6, 0, 0)], 5126, "VEC3"),
        "ROTATION": gltf.accessor([(0, 0, 0, 1), (0, 0, half, half), (0, 0, 0, 1)], 5126, "VEC4"),
        "SCALE": gltf.accessor([(1, 1, 1), (1, 1, 1), (1, 2, 1)], 5126, "VEC3"),
    }
    gltf.node(name="post", mesh=cube, extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    gltf.header["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    if required:
        gltf.header["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    mesh = load(write(tmp_path / "a.glb", gltf.glb()))
    assert len(mesh.parts) == 3
    assert np.allclose(mesh.bounds, [(0, 0, 0), (7, 2, 1)], atol=1e-6)
    assert np.allclose(mesh.vertices[mesh.parts[1].vertices].min(axis=0), (2, 0, 0), atol=1e-6)
    mesh.save(tmp_path / "same.glb")
    assert (tmp_path / "same.glb").read_bytes() == (tmp_path / "a.glb").read_bytes()
    moved = bent(mesh.vertices)
    mesh.save(tmp_path / "moved.glb", moved)
    again = load(tmp_path / "moved.glb")
    assert np.allclose(again.vertices[again.faces], moved[mesh.faces], rtol=0, atol=1e-5)
    assert "extensionsRequired" not in header_and_data(tmp_path / "moved.glb")[0]


def test_a_hidden_node_is_not_shown_but_saved(tmp_path):
    gltf = Gltf()
    cube = gltf.mesh("cube", CORNERS, CUBE)
    gltf.node(name="a", mesh=cube)
    gltf.node(name="b", extensions={"KHR_node_visibility": {"visible": False}}, children=[2])
    gltf.header["nodes"].append({"name": "c", "mesh": cube, "translation": [5, 0, 0]})
    mesh = load(write(tmp_path / "a.glb", gltf.glb()))
    assert mesh.part_names == ("a",)
    mesh.save(tmp_path / "moved.glb", mesh.vertices * 2)
    header, _ = header_and_data(tmp_path / "moved.glb")
    assert header["nodes"][1:] == gltf.header["nodes"][1:]
    assert len(header["meshes"]) == 2


@pytest.mark.parametrize("first", [False, True])
def test_lines_and_points_follow_the_surface_when_saved(first, tmp_path):
    gltf = Gltf()
    cube = gltf.mesh("cube", CORNERS, CUBE)
    primitives = gltf.header["meshes"][cube]["primitives"]
    apart = gltf.accessor(CORNERS + 0.01, 5126, "VEC3")
    lines = [{"attributes": {"POSITION": each}, "mode": mode} for each, mode in ((0, 1), (apart, 0))]
    primitives[:] = [*lines, *primitives] if first else [*primitives, *lines]
    gltf.node(mesh=cube)
    mesh = load(write(tmp_path / "a.glb", gltf.glb()))
    moved = bent(mesh.vertices)
    mesh.save(tmp_path / "moved.glb", moved)
    scene = load(tmp_path / "moved.glb").scene
    shared, own = (each.vertices for each in scene.strands)
    assert np.allclose(shared, moved, atol=1e-6)
    assert np.allclose(own, moved + 0.01, atol=1e-6)


def test_an_unknown_chunk_of_a_glb_survives(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    chunk = struct.pack("<II", 8, 0x31415926) + b"keep me!"
    data = gltf.glb() + chunk
    mesh = load(write(tmp_path / "a.glb", data[:8] + struct.pack("<I", len(data)) + data[12:]))
    mesh.save(tmp_path / "moved.glb", mesh.vertices * 2)
    assert (tmp_path / "moved.glb").read_bytes().endswith(chunk)
