"""Normals of files without normals: flat or smooth as the file says, else divided at edges of more than 30°."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE, Gltf, write

from dfd.mesh.file.shading import FLAT, UNSAID, corner_normals
from dfd.mesh.mesh import Mesh, load


def strip(degrees: float, steps: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """A strip of quads, each turned by an angle against the one before."""
    turns = np.radians(degrees) * np.arange(steps)
    line = np.vstack([np.zeros(2), np.cumsum(np.stack([np.cos(turns), np.sin(turns)], axis=1), axis=0)])
    vertices = np.array([(x, y, z) for x, y in line for z in (0.0, 1.0)])
    faces = [(2 * i, 2 * i + 2, 2 * i + 3) for i in range(steps)] + [
        (2 * i, 2 * i + 3, 2 * i + 1) for i in range(steps)
    ]
    return vertices, np.array(faces)


def least_cosine(path: Path) -> float:
    """Return the smallest cosine between the normal of a face corner and the normal of its face."""
    scene = load(path).scene
    assert scene is not None
    found = []
    for each in scene.primitives:
        assert each.normals is not None
        faces = each.geometry.faces
        a, b, c = (each.vertices[faces[:, corner]] for corner in range(3))
        up = np.cross(b - a, c - a)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        found.append(np.einsum("fi,fci->fc", up, each.normals[faces]).min())
    return float(min(found))


def obj(vertices: np.ndarray, faces: np.ndarray, said: str = "") -> str:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    return "\n".join([*lines, said, *("f {} {} {}".format(*face) for face in faces + 1), ""])


WRITERS: dict[str, Callable[[Path, np.ndarray, np.ndarray], object]] = {
    ending: lambda path, vertices, faces: Mesh(vertices, faces).save(path) for ending in ("ply", "stl", "off", "obj")
}


@pytest.mark.parametrize("ending", WRITERS)
@pytest.mark.parametrize(("degrees", "sharp"), [(29, False), (31, True), (90, True)])
def test_an_angle_of_thirty_degrees_divides(ending: str, degrees: float, sharp: bool, tmp_path: Path) -> None:
    vertices, faces = strip(degrees)
    WRITERS[ending](tmp_path / f"a.{ending}", vertices, faces)
    load(tmp_path / f"a.{ending}").save(tmp_path / "a.glb")
    least = least_cosine(tmp_path / "a.glb")
    assert (least > 0.9999) == sharp
    if not sharp:
        assert least < np.cos(np.radians(degrees / 4))


@pytest.mark.parametrize("ending", WRITERS)
def test_a_box_has_sharp_edges(ending: str, tmp_path: Path) -> None:
    WRITERS[ending](tmp_path / f"a.{ending}", CORNERS, CUBE)
    load(tmp_path / f"a.{ending}").save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") > 0.9999


@pytest.mark.parametrize("source", ["arrays", "trimesh"])
def test_a_mesh_from_memory_keeps_its_vertices(source: str, tmp_path: Path) -> None:
    mesh = Mesh(CORNERS, CUBE) if source == "arrays" else load(trimesh.Trimesh(CORNERS, CUBE, process=False))
    mesh.save(tmp_path / "a.glb")
    scene = load(tmp_path / "a.glb").scene
    assert scene is not None
    assert np.array_equal(scene.primitives[0].vertices, CORNERS)


@pytest.mark.parametrize("said", ["s off", "s 0", "s null"])
def test_an_obj_that_says_flat_is_flat(said: str, tmp_path: Path) -> None:
    load(write(tmp_path / "a.obj", obj(*strip(10), said))).save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") > 0.9999


def test_an_obj_that_says_smooth_is_smooth_over_sharp_edges(tmp_path: Path) -> None:
    load(write(tmp_path / "a.obj", obj(CORNERS, CUBE, "s 1"))).save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") < 0.8


def test_smoothing_groups_of_an_obj_divide(tmp_path: Path) -> None:
    vertices, faces = strip(10, steps=2)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    for side in (0, 1):
        lines += [f"s {side + 1}", *("f {} {} {}".format(*face) for face in faces[side::2] + 1)]
    load(write(tmp_path / "a.obj", "\n".join([*lines, ""]))).save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") > 0.9999


def test_a_gltf_file_without_normals_is_flat_in_an_obj_and_back(tmp_path: Path) -> None:
    gltf = Gltf()
    vertices, faces = strip(10)
    gltf.node(mesh=gltf.mesh("strip", vertices, faces))
    load(write(tmp_path / "a.glb", gltf.glb())).save(tmp_path / "a.obj")
    load(tmp_path / "a.obj").save(tmp_path / "b.glb")
    assert least_cosine(tmp_path / "b.glb") > 0.9999


def test_a_smooth_shape_keeps_its_vertices(tmp_path: Path) -> None:
    vertices, faces = strip(10)
    write(tmp_path / "a.obj", obj(vertices, faces))
    load(tmp_path / "a.obj").save(tmp_path / "a.glb")
    scene = load(tmp_path / "a.glb").scene
    assert scene is not None
    assert len(scene.primitives[0].vertices) == len(vertices)


def test_faces_of_one_vertex_share_normals_by_their_edges() -> None:
    vertices, faces = strip(20, steps=3)
    group, normals = corner_normals(vertices, faces, np.full(len(faces), UNSAID))
    assert len(np.unique(group)) == len(vertices)
    assert np.allclose(np.linalg.norm(normals[np.unique(group)], axis=1), 1)
    flat, _ = corner_normals(vertices, faces, np.full(len(faces), FLAT))
    assert len(np.unique(flat)) == 3 * len(faces)


def test_faces_without_area_and_faces_that_are_wound_otherwise(tmp_path: Path) -> None:
    vertices, faces = strip(10)
    sliver = np.vstack([faces, [(2, 2, 3)], [(2, 3, 2)]])
    group, _ = corner_normals(vertices, sliver, np.full(len(sliver), UNSAID))
    assert len(np.unique(group)) == len(vertices)
    turned = faces.copy()
    turned[1::4] = turned[1::4, ::-1]
    Mesh(vertices, turned).save(tmp_path / "a.obj")
    load(tmp_path / "a.obj").save(tmp_path / "a.glb")
    assert least_cosine(tmp_path / "a.glb") > 0.9
