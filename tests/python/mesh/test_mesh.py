"""Meshes: what is read, what is refused, and what a round trip through a file keeps."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import resource
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mesh_files import CORNERS, CUBE, Gltf, checkered, obj_cube, textured_quad, write
from PIL import Image

from dfd.mesh.mesh import Mesh, load
from dfd.mesh.weld import weld

FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf")


def same_shape(a: Mesh, b: Mesh, tolerance: float = 1e-6) -> bool:
    """Whether two meshes have the same triangles in the same order, whatever their vertices are numbered."""
    return a.faces.shape == b.faces.shape and np.allclose(
        a.vertices[a.faces], b.vertices[b.faces], rtol=0, atol=tolerance
    )


# --- welding ---


@given(arrays(np.int8, st.tuples(st.integers(0, 40), st.just(3)), elements=st.integers(-1, 1)))
@settings(max_examples=50, deadline=None)
def test_weld_numbers_distinct_rows_in_order_of_appearance(values: np.ndarray) -> None:
    positions = values * 0.1
    first, vertex = weld(positions)
    assert np.array_equal(positions[first][vertex], positions)
    assert len({tuple(row) for row in (positions + 0.0).tolist()}) == len(first)
    assert np.all(np.diff(first) > 0)


def test_weld_takes_minus_zero_for_zero_and_nothing_else_for_equal() -> None:
    tiny = np.nextafter(0, 1)
    first, vertex = weld(np.array([(0.0, 0, 0), (-0.0, 0, 0), (tiny, 0, 0)]))
    assert first.tolist() == [0, 2]
    assert vertex.tolist() == [0, 0, 1]


def test_weld_survives_a_hash_that_cannot_tell_rows_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.array([(1.0, 0, 0), (2.0, 0, 0), (1.0, 0, 0), (2.0, 0, 0), (3.0, 0, 0)])
    monkeypatch.setattr("dfd.mesh.weld._hash", lambda values: np.zeros(len(values), np.uint64))
    first, vertex = weld(rows)
    assert first.tolist() == [0, 1, 4]
    assert vertex.tolist() == [0, 1, 0, 1, 2]


# --- the class ---


def test_a_mesh_keeps_its_arrays_to_itself() -> None:
    vertices, faces = CORNERS.copy(), CUBE.copy()
    mesh = Mesh(vertices, faces)
    vertices[:] = 7
    faces[:] = 0
    assert np.array_equal(mesh.vertices, CORNERS)
    assert np.array_equal(mesh.faces, CUBE)
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int32
    for array in (mesh.vertices, mesh.faces, mesh.normals, mesh.bounds, mesh.extents):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_size_and_normals_of_a_cube() -> None:
    mesh = Mesh(CORNERS * 2, CUBE)
    assert mesh.bounds.tolist() == [[0, 0, 0], [2, 2, 2]]
    assert mesh.extents.tolist() == [2, 2, 2]
    assert mesh.diagonal == pytest.approx(np.sqrt(12))
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1)
    assert np.all(np.einsum("ij,ij->i", mesh.normals, CORNERS - 0.5) > 0.7)


def test_normals_of_faces_without_area_are_zero_not_nan() -> None:
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0), (5, 5, 5)], [(0, 1, 2), (0, 0, 1)])
    assert np.array_equal(mesh.normals, np.zeros((4, 3)))


def test_content_hash_tells_meshes_apart_and_nothing_else() -> None:
    mesh, same = Mesh(CORNERS, CUBE), Mesh(CORNERS.copy(), CUBE.astype(np.int64))
    moved, turned = Mesh(CORNERS + 1e-12, CUBE), Mesh(CORNERS, CUBE[:, [1, 2, 0]])
    assert mesh.content_hash == same.content_hash
    assert len({mesh.content_hash, moved.content_hash, turned.content_hash}) == 3


def test_degenerate_and_duplicate_faces_are_kept() -> None:
    faces = [(0, 1, 3), (0, 1, 3), (2, 2, 2), (0, 1, 0)]
    assert Mesh(CORNERS, faces).faces.tolist() == [list(face) for face in faces]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (CORNERS[:, :2], CUBE, r"`vertices` must have shape \(V, 3\), got \(8, 2\)"),
        ("corners", CUBE, "`vertices` must be a numeric array"),
        (CORNERS * np.nan, CUBE, r"`vertices` must be finite, got nan at \[0, 0\]"),
        (CORNERS[:2], [(0, 1, 1)], "`vertices` must hold at least 3 vertices, got 2"),
        (CORNERS, np.zeros((0, 3), int), "`faces` must hold at least one face"),
        (CORNERS, CUBE[:, :2], r"`faces` must be whole numbers of shape \(F, 3\), got int64 of shape \(12, 2\)"),
        (CORNERS, CUBE * 1.0, "`faces` must be whole numbers"),
        (CORNERS, CUBE + 1, r"`faces` must name vertices 0 … 7, got 8"),
        (CORNERS, CUBE - 1, r"`faces` must name vertices 0 … 7, got -1"),
        (CORNERS, np.full((1, 3), 2**40), "`faces` must name vertices 0 … 7, got 1099511627776"),
    ],
)
def test_bad_arrays_are_refused(vertices: object, faces: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Mesh(vertices, faces)


# --- reading ---


@pytest.mark.parametrize("ending", FORMATS)
def test_a_plain_cube_is_read_from_every_format(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"cube.{ending}"
    trimesh.Scene(trimesh.Trimesh(CORNERS, CUBE, process=False)).export(path) if ending != "off" else trimesh.Trimesh(
        CORNERS, CUBE, process=False
    ).export(path)
    mesh = load(path)
    assert mesh.vertices.shape == (8, 3)
    assert same_shape(mesh, Mesh(CORNERS, CUBE))
    assert mesh.source == path
    assert repr(mesh) == f"Mesh(cube.{ending}: 8 vertices, 12 faces)"


def test_obj_vertices_keep_the_files_numbers_across_parts_seams_and_unused_ones(tmp_path: Path) -> None:
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
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert mesh.faces.tolist() == [[2, 3, 1], [0, 1, 2], [0, 2, 1]]
    assert mesh.part_count == 2


def test_quads_and_relative_numbers_in_obj(tmp_path: Path) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS[[0, 2, 6, 4]]]
    mesh = load(write(tmp_path / "quad.obj", "\n".join([*lines, "f -4 -3 -2 -1"])))
    assert mesh.faces.shape == (2, 3)
    assert len(mesh.vertices) == 4


def test_scene_transforms_and_instances_are_applied(tmp_path: Path) -> None:
    gltf = Gltf()
    cube = gltf.mesh("cube", CORNERS, CUBE)
    gltf.node(name="here", mesh=cube)
    gltf.node(name="there", mesh=cube, translation=[5, 0, 0], scale=[2, 2, 2])
    mesh = load(write(tmp_path / "two.glb", gltf.glb()))
    assert mesh.bounds.tolist() == [[0, 0, 0], [7, 2, 2]]
    assert len(mesh.vertices) == 16
    assert mesh.part_count == 2


def test_parts_that_touch_share_their_vertices(tmp_path: Path) -> None:
    gltf = Gltf()
    for name, offset in (("left", 0), ("right", 1)):
        gltf.node(name=name, mesh=gltf.mesh(name, CORNERS + [offset, 0, 0], CUBE))
    assert len(load(write(tmp_path / "touching.glb", gltf.glb())).vertices) == 12


def reads(path: Path) -> str:
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
        ("empty.glb", "", "is empty"),
        ("words.obj", "once upon a time\n", "holds no faces|not a well-formed"),
        ("words.ply", "once upon a time\n", "not a well-formed PLY"),
        ("words.off", "once upon a time\n", "not a well-formed OFF"),
        ("words.stl", "once upon a time\n", "not a well-formed STL|holds no faces"),
        ("words.gltf", "once upon a time\n", "not a well-formed GLTF"),
        ("list.gltf", "[1, 2]", "its JSON is a list"),
        ("deep.gltf", "[" * 100_000, "not a well-formed GLTF"),
        ("cloud.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "holds no faces"),
        ("cloud.ply", PLY.format(n=1) + "end_header\n0 0 0\n", "holds no faces|not a well-formed"),
        ("one.obj", "v 0 0 0\nf 1 1 1\n", "at least 3 distinct vertices, got 1"),
        ("nan.obj", obj_cube().replace("v 0 0 0", "v 0 nan 0"), "must hold finite coordinates, got nan at vertex 0"),
        ("inf.obj", obj_cube().replace("v 1 1 1", "v 1 inf 1"), "must hold finite coordinates, got inf at vertex 7"),
        ("high.obj", obj_cube() + "f 1 2 9\n", "not a well-formed OBJ"),
        ("low.obj", obj_cube() + "f -99 1 2\n", "not a well-formed OBJ"),
        ("zero.obj", obj_cube() + "f 0 1 2\n", "a face names vertex 0, but the first is 1"),
        ("letters.obj", obj_cube() + "f a b c\n", "not a well-formed OBJ"),
        ("cut.obj", obj_cube()[:30], "holds no faces"),
        ("high.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "not a well-formed OFF"),
        ("cut.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n", "not a well-formed OFF"),
        ("many.off", "OFF\n999999999999 1 0\n0 0 0\n", "not a well-formed OFF"),
        ("cube.fbx", obj_cube(), "must end in .obj, .ply, .stl, .off, .glb, .gltf"),
        ("cube", obj_cube(), "must end in"),
    ],
)
def test_malformed_files_get_one_sentence(name: str, content: str, message: str, tmp_path: Path) -> None:
    found = reads(write(tmp_path / name, content))
    assert re.search(message, found), found


def test_files_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="could not be read: No such file"):
        load(tmp_path / "absent.obj")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(OSError, match="it is not a file"):
        load(tmp_path / "folder.obj")


@pytest.mark.parametrize("ending", ["ply", "stl", "glb", "off"])
def test_files_cut_off_anywhere_are_refused_or_lack_faces(ending: str, tmp_path: Path) -> None:
    whole = tmp_path / f"whole.{ending}"
    Mesh(CORNERS, CUBE).save(whole)
    data = whole.read_bytes()
    for length in range(1, len(data) - 12, max(1, len(data) // 40)):
        path = write(tmp_path / f"cut.{ending}", data[:length])
        with contextlib.suppress(ValueError):
            assert len(load(path).faces) < 12


def break_header(change: Callable[[dict], object]) -> bytes:
    gltf = Gltf()
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE))
    change(gltf.header)
    return gltf.glb()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda h: h["accessors"][0].update(count=2_000_000_000), "accessor 0 has 2000000000 items up to byte"),
        (lambda h: h["accessors"][0].update(count=-1), "accessor 0 has count -1"),
        (lambda h: h["accessors"][0].update(count="8"), "accessor 0 has count '8'"),
        (lambda h: h["accessors"][0].update(byteOffset=10**9), "accessor 0 has 8 items up to byte"),
        (lambda h: h["accessors"][0].update(bufferView=7), "accessor 0 names bufferView 7, but there are 2"),
        (lambda h: h["accessors"][0].update(type="VEC5"), "accessor 0 has the unknown type 'VEC5'"),
        (lambda h: h["accessors"][0].update(componentType=1), "accessor 0 has the unknown componentType 1"),
        (lambda h: h["accessors"][0].update(normalized=True), "of positions, is normalized"),
        (lambda h: h["accessors"][0].update(sparse={}), "of positions, is sparse"),
        (lambda h: h["accessors"][0].pop("bufferView"), "accessor 0, of positions, has no data"),
        (lambda h: h["accessors"].append({"count": 2**33, "componentType": 5126, "type": "MAT4"}), "but no data"),
        (lambda h: h["bufferViews"][0].update(byteLength=10**9), "bufferView 0 ends at byte"),
        (lambda h: h["bufferViews"][0].update(buffer=3), "bufferView 0 names buffer 3, but there are 1"),
        (lambda h: h["meshes"][0]["primitives"][0].update(indices=9), "names accessor 9 for its indices"),
        (lambda h: h["meshes"][0]["primitives"][0].update(attributes={}), "names accessor None for its positions"),
        (lambda h: h["nodes"][0].update(children=[0]), "its nodes are their own ancestors"),
        (lambda h: h["nodes"][0].update(children=[5]), "node 0 has children that are not there"),
        (lambda h: h["nodes"].extend({"children": [0]} for _ in range(2)), "node 0 is the child of more than one"),
        (
            lambda h: (h["nodes"].extend({"children": [i]} for i in range(2000)), h["scenes"][0].update(nodes=[2000])),
            "nested more than 1000 deep",
        ),
        (lambda h: h["nodes"][0].update(scale=[1e308, 1, 1], translation=[1e308, 0, 0]), "finite"),
        (lambda h: h.update(nodes=5), "its 'nodes' must be a list of objects"),
        (lambda h: h.update(extensionsRequired=["KHR_draco_mesh_compression"]), "compressed with KHR_draco"),
        (lambda h: h.update(scene=5), "not a well-formed GLB"),
    ],
)
def test_headers_that_cannot_be_right_are_refused(
    change: Callable[[dict], object], message: str, tmp_path: Path
) -> None:
    assert message in reads(write(tmp_path / "broken.glb", break_header(change)))


def test_views_that_overlap_a_hundred_times_are_refused(tmp_path: Path) -> None:
    def overlap(header: dict) -> None:
        header["bufferViews"] += [{"buffer": 0, "byteLength": 200_000} for _ in range(200)]

    gltf = Gltf()
    gltf.view(bytes(200_000))
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE))
    overlap(gltf.header)
    assert "its bufferViews add up to" in reads(write(tmp_path / "overlap.glb", gltf.glb()))


@pytest.mark.skipif("DFD_CORPUS" not in os.environ, reason="DFD_CORPUS names no folder of malformed files")
def test_the_corpus_neither_crashes_nor_hangs_nor_fills_the_memory() -> None:
    program = """
import pathlib, resource, sys, warnings
from dfd.mesh.mesh import load
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
warnings.simplefilter("ignore")
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    try:
        load(path)
    except (ValueError, OSError) as error:
        assert str(error).count(str(path)) == 1 and "\\n" not in str(error), error
assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000
"""
    subprocess.run([sys.executable, "-c", program, os.environ["DFD_CORPUS"]], check=True, timeout=120)


# --- writing ---


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("moved", [False, True])
def test_a_mesh_from_arrays_comes_back_from_every_format(ending: str, moved: bool, tmp_path: Path) -> None:
    mesh = Mesh(CORNERS, CUBE)
    vertices = CORNERS * [1, 2, 3] + 5 if moved else None
    path = tmp_path / f"cube.{ending}"
    mesh.save(path, vertices)
    assert same_shape(load(path), Mesh(CORNERS if vertices is None else vertices, CUBE))
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_text_formats_keep_every_bit(tmp_path: Path) -> None:
    vertices = CORNERS / 3 + np.pi
    for ending in ("obj", "off"):
        Mesh(vertices, CUBE).save(tmp_path / f"exact.{ending}")
        assert np.allclose(load(tmp_path / f"exact.{ending}").vertices, vertices, rtol=1e-15, atol=0)


def scene_of_three(tmp_path: Path) -> Path:
    """A textured square, and a coloured cube placed twice, once turned and shrunk."""
    gltf = textured_quad(tmp_path)
    colors = np.tile(np.array([(255, 0, 0, 255), (0, 255, 0, 255)], np.uint8), (4, 1))
    cube = gltf.mesh("cube", CORNERS, CUBE, attributes={"COLOR_0": gltf.accessor(colors, 5121, "VEC4")})
    gltf.header["accessors"][gltf.header["meshes"][cube]["primitives"][0]["attributes"]["COLOR_0"]]["normalized"] = True
    half = float(np.sqrt(0.5))
    gltf.node(name="near", mesh=cube, translation=[3, 0, 0])
    gltf.node(name="far", mesh=cube, translation=[0, 0, -9], rotation=[0, half, 0, half], scale=[0.5, 2, 1])
    return write(tmp_path / "three.glb", gltf.glb())


@pytest.mark.parametrize("ending", ["glb", "gltf", "obj"])
def test_a_scene_keeps_parts_materials_and_colours(ending: str, tmp_path: Path) -> None:
    mesh = load(scene_of_three(tmp_path))
    mesh.save(tmp_path / f"out.{ending}")
    again = load(tmp_path / f"out.{ending}")
    assert same_shape(mesh, again)
    assert again.part_count == 3 if ending != "obj" else again.part_count == 2
    assert mesh.appearance is not None
    assert again.appearance is not None
    faces, middle = np.arange(len(mesh.faces)), np.full((len(mesh.faces), 3), 1 / 3, np.float32)
    before, after = mesh.appearance.albedo(faces, middle), again.appearance.albedo(faces, middle)
    assert np.abs(before - after).max() < 0.01
    names = set(trimesh.load_scene(tmp_path / f"out.{ending}", split_objects=True).geometry)
    assert {name.split("_")[0] for name in names} >= {"square", "cube"}


def test_instances_that_move_apart_are_split_and_those_that_rest_are_not(tmp_path: Path) -> None:
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


def test_a_seam_stays_closed_and_keeps_both_its_texture_coordinates(tmp_path: Path) -> None:
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


def test_an_unmoved_vertex_keeps_its_bits_through_a_turned_node(tmp_path: Path) -> None:
    path = scene_of_three(tmp_path)
    mesh = load(path)
    vertices = mesh.vertices.copy()
    vertices[-1] += 1
    mesh.save(tmp_path / "moved.glb", vertices)
    again = load(tmp_path / "moved.glb")
    assert np.array_equal(again.vertices[:-1], mesh.vertices[:-1])


def test_vertices_that_no_face_uses_stay_in_their_place_and_out_of_the_mesh(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(name="cube", mesh=gltf.mesh("cube", np.vstack([[(9.0, 9, 9)], CORNERS]), CUBE + 1))
    mesh = load(write(tmp_path / "stray.glb", gltf.glb()))
    assert np.array_equal(mesh.vertices, CORNERS)
    mesh.save(tmp_path / "out.glb", CORNERS * 2)
    geometry = next(iter(trimesh.load_scene(tmp_path / "out.glb", process=False).geometry.values()))
    assert np.array_equal(geometry.vertices, np.vstack([[(9, 9, 9)], CORNERS * 2]))


def sharp_cube(tmp_path: Path) -> Path:
    """A cube of 24 vertices, each with the normal of its side, wound outwards."""
    vertices = CORNERS[CUBE].reshape(-1, 3)
    cube = trimesh.Trimesh(vertices, np.arange(36).reshape(-1, 3), process=False)
    cube.vertex_normals = np.repeat(cube.face_normals, 3, axis=0)
    path = tmp_path / "sharp.glb"
    path.write_bytes(trimesh.exchange.gltf.export_glb(trimesh.Scene(cube), include_normals=True))
    return path


def test_normals_follow_the_surface_and_edges_stay_sharp(tmp_path: Path) -> None:
    mesh = load(sharp_cube(tmp_path))
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    mesh.save(tmp_path / "turned.glb", mesh.vertices @ turn.T)
    geometry = next(iter(trimesh.load_scene(tmp_path / "turned.glb", process=False).geometry.values()))
    expected = np.repeat(geometry.face_normals, 3, axis=0)
    assert np.allclose(geometry.vertex_normals[geometry.faces.ravel()], expected, atol=1e-5)


def test_normals_far_from_what_moved_are_the_files_own(tmp_path: Path) -> None:
    mesh = load(sharp_cube(tmp_path))
    vertices = mesh.vertices.copy()
    vertices[np.argmax(vertices.sum(axis=1))] += 1
    mesh.save(tmp_path / "pulled.glb", vertices)
    before = next(iter(trimesh.load_scene(tmp_path / "sharp.glb", process=False).geometry.values()))
    after = next(iter(trimesh.load_scene(tmp_path / "pulled.glb", process=False).geometry.values()))
    rest = np.repeat(~np.isin(CUBE, 7).any(axis=1), 3)
    same = np.abs(after.vertex_normals - before.vertex_normals).max(axis=1) == 0
    at_origin_sides = np.isclose(before.vertices[:, None], 0).any(axis=2).ravel() & rest
    assert same[at_origin_sides & (np.abs(before.vertex_normals).min(axis=1) == 0) & rest].all()
    assert not same.all()
    assert np.isfinite(after.vertex_normals).all()


def test_a_mirrored_placing_keeps_normals_outside(tmp_path: Path) -> None:
    gltf = Gltf()
    normals = gltf.accessor((CORNERS - 0.5) / np.sqrt(0.75), 5126, "VEC3")
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE, attributes={"NORMAL": normals}), scale=[-1, 1, 1])
    mesh = load(write(tmp_path / "mirrored.glb", gltf.glb()))
    mesh.save(tmp_path / "out.glb", mesh.vertices * 2)
    geometry = next(iter(trimesh.load_scene(tmp_path / "out.glb", process=False).geometry.values()))
    outward = geometry.vertices - geometry.vertices.mean(axis=0)
    assert np.all(np.einsum("ij,ij->i", geometry.vertex_normals, outward) > 0)


def test_textures_become_vertex_colours_in_ply(tmp_path: Path) -> None:
    mesh = load(write(tmp_path / "quad.glb", textured_quad(tmp_path).glb()))
    mesh.save(tmp_path / "quad.ply")
    look = load(tmp_path / "quad.ply").appearance
    assert look is not None
    corners = look.albedo(np.zeros(3, int), np.eye(3))
    assert mesh.appearance is not None
    assert np.allclose(corners, mesh.appearance.albedo(np.zeros(3, int), np.eye(3)), atol=0.01)


def test_saving_an_obj_overwrites_no_other_files_texture(tmp_path: Path) -> None:
    checkered(tmp_path / "paint.png")
    original = (tmp_path / "paint.png").read_bytes()
    write(tmp_path / "cube.mtl", "newmtl paint\nmap_Kd paint.png\n")
    text = "mtllib cube.mtl\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl paint\n" + obj_cube().replace("f ", "f ")
    lines = [
        line if not line.startswith("f ") else "f " + " ".join(f"{n}/1" for n in line[2:].split())
        for line in text.splitlines()
    ]
    mesh = load(write(tmp_path / "cube.obj", "\n".join(lines)))
    mesh.save(tmp_path / "out.obj", mesh.vertices * 2)
    assert (tmp_path / "paint.png").read_bytes() == original
    assert {path.name for path in tmp_path.iterdir()} >= {"out.obj", "out.mtl", "out_paint.png"}
    assert load(tmp_path / "out.obj").appearance is not None


def test_colours_and_jpeg_textures_cross_formats_unharmed(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (32, 32, 3), dtype=np.uint8)
    Image.fromarray(picture).save(tmp_path / "paint.jpg")
    write(tmp_path / "quad.mtl", "newmtl paint\nmap_Kd paint.jpg\nnewmtl plain\nKd 0.25 0.5 0.75\n")
    lines = ["mtllib quad.mtl", "v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "vt 0 0", "vt 1 0", "vt 1 1"]
    lines += ["usemtl paint", "f 1/1 2/2 3/3", "usemtl plain", "f 1/1 3/3 4/2"]
    mesh = load(write(tmp_path / "quad.obj", "\n".join(lines)))
    mesh.save(tmp_path / "one.glb")
    load(tmp_path / "one.glb").save(tmp_path / "two.obj")
    look, again = mesh.appearance, load(tmp_path / "two.obj").appearance
    assert look is not None
    assert again is not None
    assert np.array_equal(look.materials[0].texture, again.materials[0].texture)
    assert np.allclose(look.materials[1].color, again.materials[1].color, atol=0.006)
    assert np.allclose(again.materials[1].color, (0.25, 0.5, 0.75, 1), atol=0.006)


# --- glTF files are patched, not rewritten ---


def header_and_data(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def view_bytes(path: Path, view: int) -> bytes:
    header, data = header_and_data(path)
    found = header["bufferViews"][view]
    return data[found["byteOffset"] : found["byteOffset"] + found["byteLength"]]


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
    assert (len(mesh.vertices), mesh.part_count) == (8, 2)
    mesh.save(tmp_path / "out.glb", mesh.vertices[::-1])
    again = load(tmp_path / "out.glb")
    assert same_shape(again, Mesh(mesh.vertices[::-1], mesh.faces))
    primitives = header_and_data(tmp_path / "out.glb")[0]["meshes"][0]["primitives"]
    assert primitives[0]["attributes"] == primitives[1]["attributes"]


def test_data_and_pictures_in_files_of_their_own_are_taken_along(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.mkdir()
    gltf = textured_quad(tmp_path)
    gltf.header["images"] = [{"uri": "paint.png"}]
    checkered(source / "paint.png")
    write(source / "data.bin", gltf.data)
    gltf.header["buffers"] = [{"uri": "data.bin", "byteLength": len(gltf.data)}]
    path = write(source / "quad.gltf", json.dumps(gltf.header))
    mesh = load(path)
    assert mesh.appearance is not None
    for ending in ("glb", "gltf"):
        mesh.save(tmp_path / f"out.{ending}", mesh.vertices + 1)
        look = load(tmp_path / f"out.{ending}").appearance
        assert look is not None
        assert np.array_equal(look.materials[0].texture, mesh.appearance.materials[0].texture)


def test_nodes_of_the_same_name_are_told_apart(tmp_path: Path) -> None:
    gltf = Gltf()
    for offset in (0, 4, 8):
        gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE), translation=[offset, 0, 0])
    mesh = load(write(tmp_path / "three.glb", gltf.glb()))
    vertices = mesh.vertices + np.where(mesh.vertices[:, :1] > 7, 1.0, 0.0)
    mesh.save(tmp_path / "out.glb", vertices)
    assert same_shape(load(tmp_path / "out.glb"), Mesh(vertices, mesh.faces))
    before, after = header_and_data(tmp_path / "three.glb")[0], header_and_data(tmp_path / "out.glb")[0]
    assert after["meshes"][:2] == before["meshes"][:2]
    assert after["nodes"] == before["nodes"]


# --- writing that fails ---


def test_saving_refuses_what_it_cannot_write(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("ending", ["ply", "stl", "glb", "gltf"])
def test_coordinates_that_a_format_cannot_hold_are_refused(ending: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"must fit in 32-bit floats for a .{ending} file"):
        Mesh(CORNERS, CUBE).save(tmp_path / f"cube.{ending}", CORNERS * 1e39)
    Mesh(CORNERS, CUBE).save(tmp_path / "cube.OFF", CORNERS * 1e39)
    assert load(tmp_path / "cube.OFF").extents[0] == 1e39


def test_a_scene_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
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


@pytest.mark.parametrize("ending", FORMATS)
def test_a_full_disk_leaves_the_old_file_whole(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"cube.{ending}"
    Mesh(CORNERS, CUBE).save(path)
    before = path.read_bytes()
    fine = trimesh.creation.icosphere(3)
    big = Mesh(fine.vertices, fine.faces)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))  # writing beyond raises, as on a full disk
    try:
        with pytest.raises(OSError, match="could not be written") as caught:
            big.save(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caught.value.errno == errno.EFBIG
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
