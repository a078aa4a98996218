"""Test that the page receives every triangle of the mesh, with the materials and normals of its file."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import dfd
from dfd.app.session.surface import mesh_message
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.mesh import Mesh


def sent(mesh: Mesh) -> tuple[dict[str, Any], dict[str, Any]]:
    message, arrays = mesh_message(mesh, name="a mesh", warnings=["a warning"])
    header = message.model_dump(mode="json")
    assert header["type"] == "mesh"
    assert (header["name"], header["warnings"]) == ("a mesh", ["a warning"])
    assert (header["vertices"], header["faces"]) == (len(mesh.vertices), len(mesh.faces))
    assert len(arrays["positions"]) == len(arrays["vertex"]) == len(arrays["normals"])
    corners = arrays["positions"][arrays["triangles"]].astype(np.float64) + header["center"]
    np.testing.assert_allclose(corners, mesh.vertices[mesh.faces], atol=1e-6 * mesh.diagonal)
    np.testing.assert_array_equal(arrays["vertex"][arrays["triangles"]], mesh.faces)
    assert sum(group["count"] for group in header["groups"]) == len(mesh.faces)
    return header, arrays


def test_a_mesh_from_arrays() -> None:
    mesh = dfd.samples.chair(4000).mesh
    header, arrays = sent(mesh)
    assert len(header["groups"]) == len(header["materials"]) == 1
    np.testing.assert_allclose(arrays["normals"][:, :3] / 32767, mesh.normals, atol=2e-5)
    assert not arrays["normals"][:, 3].any()


def test_far_from_the_origin_digits_stay() -> None:
    mesh = dfd.samples.chair(4000).mesh
    sent(Mesh(mesh.vertices + 1e6, mesh.faces))


def test_sharp_edges_of_a_file_stay_sharp(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    flat = trimesh.Trimesh(box.vertices[box.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    flat.vertex_normals = np.repeat(box.face_normals, 3, axis=0)
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, (1, 2, 3)) @ np.diag([2.0, 1.0, 1.0, 1.0])
    scene.add_geometry(flat, transform=turn)
    scene.export(tmp_path / "box.glb", include_normals=True)
    mesh = dfd.load(tmp_path / "box.glb")
    _, arrays = sent(mesh)
    assert len(arrays["positions"]) > len(mesh.vertices) == 8
    corners = arrays["positions"][arrays["triangles"]].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    normals = arrays["normals"][arrays["triangles"]][..., :3] / 32767
    np.testing.assert_allclose(normals, np.repeat(across[:, None], 3, axis=1), atol=1e-4)


@pytest.mark.parametrize("alpha", [255, 100])
def test_textures_travel_as_pictures(alpha: int) -> None:
    mesh = dfd.samples.chair(4000).mesh
    texture = np.full((8, 16, 4), (200, 40, 10, alpha), np.uint8)
    looks = Appearance(
        corners=np.arange(len(mesh.vertices), dtype=np.int32),
        corner_faces=mesh.faces,
        face_material=(np.arange(len(mesh.faces)) >= 100).astype(np.int32),
        materials=(Material(texture=texture, wrap=("clamp", "mirror")), Material(color=(1.0, 0.0, 0.0, 1.0))),
        uv=np.zeros((len(mesh.vertices), 2), np.float32),
        colors=np.full((len(mesh.vertices), 4), 0.5, np.float32),
    )
    header, arrays = sent(Mesh(mesh.vertices, mesh.faces, appearance=looks))
    first, second = header["materials"]
    assert first["media_type"] == ("image/jpeg" if alpha == 255 else "image/png")
    assert first["wrap"] == ["clamp", "mirror"]
    assert (second["texture"], second["color"]) == (None, [1, 0, 0, 1])
    assert [(group["material"], group["start"], group["count"]) for group in header["groups"]] == [
        (0, 0, 100),
        (1, 100, len(mesh.faces) - 100),
    ]
    picture = np.asarray(Image.open(io.BytesIO(arrays[first["texture"]].tobytes())).convert("RGBA"))
    np.testing.assert_allclose(picture.astype(int), texture, atol=3)
    assert (arrays["colors"] == 128).all()


def test_rows_without_a_face_do_not_travel() -> None:
    mesh = dfd.samples.chair(4000).mesh
    count = len(mesh.vertices)
    looks = Appearance(
        corners=np.concatenate([[-1, -1], np.arange(count)]).astype(np.int32),
        corner_faces=mesh.faces + np.int32(2),
        face_material=np.zeros(len(mesh.faces), np.int32),
        materials=(Material(),),
        colors=np.linspace(0, 1, 4 * (count + 2), dtype=np.float32).reshape(-1, 4),
    )
    _, arrays = sent(Mesh(mesh.vertices, mesh.faces, appearance=looks))
    assert len(arrays["positions"]) == len(arrays["colors"]) == count
    np.testing.assert_array_equal(arrays["colors"][0], np.rint(looks.colors[2] * 255))
