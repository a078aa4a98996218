"""glTF files are patched, not written anew."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from mesh_files import CORNERS, CUBE, Gltf, header_and_data, same_shape, textured_quad, view_bytes, write

from dfd.mesh.mesh import Mesh, load


def test_everything_but_positions_survives_in_a_glb(tmp_path: Path) -> None:
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


def test_primitives_that_share_positions_move_together(tmp_path: Path) -> None:
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


def test_a_scene_without_normals_gets_smooth_ones(tmp_path: Path) -> None:
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
