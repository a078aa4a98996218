"""Files as other programs write them: situations from public reports of users, made anew by each test."""

from __future__ import annotations

import gzip
import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, header_and_data, look_of, obj_cube, write
from PIL import Image
from scipy.spatial.transform import Rotation

from dfd import Mesh, load

MSVC = ["nan", "-nan(ind)", "-1.#IND", "1.#QNAN", "1.#INF00", "1.#J", "inf"]
FACES = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in CUBE.tolist())
SQUARE = np.array([(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)], float)
FRONT = np.array([(0, 1, 2), (0, 2, 3)])


def normals_of(path: Path) -> list[np.ndarray]:
    scene = load(path).scene
    assert scene is not None
    return [np.asarray(each.normals_to_scene(each.normals)) for each in scene.primitives if each.normals is not None]


def bent(vertices: np.ndarray) -> np.ndarray:
    return vertices + 0.3 * np.stack([np.sin(vertices[:, 1]), vertices[:, 2] ** 2, np.cos(vertices[:, 0])], axis=1)


def stl_text(normal: str = "0 0 1", end: str = "endsolid", name: str = "left") -> str:
    facets = [
        f"facet normal {normal if not index else '0 0 1'}\n outer loop\n"
        + "".join(f"  vertex {x:g} {y:g} {z:g}\n" for x, y, z in CORNERS[face].tolist())
        + " endloop\nendfacet\n"
        for index, face in enumerate(CUBE)
    ]
    solids = [f"solid {each}\n{''.join(facets)}{end} {each}\n" for each in (name, "right")]
    return "".join(solids)


# Text: encodings, byte order marks, numbers


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
def test_materials_are_found_by_their_bytes_and_keep_them(names: list[bytes], mtl: bytes, tmp_path: Path) -> None:
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


def test_a_material_is_found_in_a_library_of_another_encoding(tmp_path: Path) -> None:
    write(tmp_path / "a.mtl", "newmtl Grün\nKd 1 0 0\n".encode("latin-1"))
    mesh = load(write(tmp_path / "a.obj", "mtllib a.mtl\nusemtl Grün\n" + obj_cube()))
    assert look_of(mesh).materials[0].color[:3] == (1, 0, 0)
    (tmp_path / "other").mkdir()
    mesh.save(tmp_path / "other" / "a.obj")
    assert look_of(tmp_path / "other" / "a.obj").materials[0].name == "Grün"


@pytest.mark.parametrize("number", MSVC)
def test_normals_that_are_no_numbers_are_missing_and_their_text_stays(number: str, tmp_path: Path) -> None:
    three = f"{number} {number} {number}"
    corners = "".join(f"f {a + 1}//1 {b + 1}//2 {c + 1}//1\n" for a, b, c in CUBE.tolist())
    vertices = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in CORNERS.tolist())
    head = "ply\nformat ascii 1.0\nelement vertex 8\n" + "".join(
        f"property float {each}\n" for each in ("x", "y", "z", "nx", "ny", "nz")
    )
    head += "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x:g} {y:g} {z:g} {three if not i else '0 0 1'}\n" for i, (x, y, z) in enumerate(CORNERS.tolist())]
    faces = "".join(f"3 {a} {b} {c}\n" for a, b, c in CUBE.tolist())
    files = {
        "a.obj": f"{vertices}vn 0 0 1\nvn {three}\n{corners}",
        "a.ply": head + "".join(rows) + faces,
        "a.stl": stl_text(three),
        "a.off": "\n".join(["NOFF", "8 12 0", *map(str.strip, rows), faces]),
    }
    for name, text in files.items():
        mesh = load(write(tmp_path / name, text))
        mesh.save(tmp_path / f"same_{name}")
        assert (tmp_path / f"same_{name}").read_text() == text
        moved = bent(mesh.vertices)
        mesh.save(tmp_path / f"moved_{name}", moved)
        assert three in (tmp_path / f"moved_{name}").read_text()
        assert np.allclose(load(tmp_path / f"moved_{name}").vertices, moved, rtol=0, atol=1e-6)
        mesh.save(tmp_path / "a.glb", moved)
        assert all(np.allclose(np.linalg.norm(each, axis=1), 1) for each in normals_of(tmp_path / "a.glb"))
    assert load(tmp_path / "a.stl").part_names == ("left", "right")


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + stl_text(),
        stl_text(end="end solid"),
        stl_text(name="facet vertex"),
        stl_text().replace("endf", "end f"),
    ],
)
def test_stl_text_with_a_mark_spaces_or_keywords_in_names_is_read_and_stays_text(text: str, tmp_path: Path) -> None:
    mesh = load(write(tmp_path / "a.stl", text))
    assert len(mesh.parts) == 2
    moved = bent(mesh.vertices)
    mesh.save(tmp_path / "moved.stl", moved)
    assert np.allclose(load(tmp_path / "moved.stl").vertices, moved, rtol=0, atol=1e-12)
    assert (tmp_path / "moved.stl").read_text().startswith(text[: text.index("\n")])


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b""])
@pytest.mark.parametrize("line_break", [b"\n", b"\r\n", b"\r"])
def test_an_obj_keeps_its_mark_and_its_continued_lines(mark: bytes, line_break: bytes, tmp_path: Path) -> None:
    text = mark + obj_cube().replace("f 1 2 4", "f 1 \\\n2 4").encode().replace(b"\n", line_break)
    if line_break == b"\r":
        text = mark + obj_cube().encode().replace(b"\n", line_break)
    mesh = load(write(tmp_path / "a.obj", text))
    mesh.save(tmp_path / "same.obj")
    assert (tmp_path / "same.obj").read_bytes() == text
    mesh.save(tmp_path / "moved.obj", bent(mesh.vertices))
    assert np.array_equal(load(tmp_path / "moved.obj").vertices, bent(mesh.vertices))


@pytest.mark.parametrize("ending", ["obj", "ply", "glb", "stl", "off", "gltf"])
@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 10\n", "Git LFS pointer"),
        (gzip.compress(obj_cube().encode(), mtime=0), "compressed data"),
        (b"PK\x03\x04" + bytes(100), "an archive, such as a ZIP file"),
        (b"\n<!DOCTYPE html><html><body>404</body></html>", "an HTML page"),
        (obj_cube().encode("utf-16"), "UTF-16"),
        (obj_cube().encode("utf-16-be"), "UTF-16"),
    ],
)
def test_a_file_that_is_something_else_is_named(data: bytes, message: str, ending: str, tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=rf"load: `path` .*a\.{ending} is not a mesh file in .* format, but .*{message}"
    ):
        load(write(tmp_path / f"a.{ending}", data))


def test_a_mesh_under_the_ending_of_another_format_is_named(tmp_path: Path) -> None:
    Mesh(CORNERS, CUBE).save(tmp_path / "a.ply")
    with pytest.raises(ValueError, match="but content of the format PLY"):
        load((tmp_path / "a.ply").rename(tmp_path / "a.glb"))


@pytest.mark.parametrize("name", ["../bin/data.bin", "lfs.bin"])
def test_data_that_is_not_read_is_named_with_the_reason(name: str, tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    gltf.header["buffers"] = [{"byteLength": len(gltf.data), "uri": name}]
    write(tmp_path / "lfs.bin", "version https://git-lfs.github.com/spec/v1\n")
    reason = "outside the folder" if name.startswith("..") else "Git LFS pointer"
    with pytest.raises(ValueError, match=f"names '{name}', which .*{reason}"):
        load(write(tmp_path / "a.gltf", json.dumps(gltf.header)))


@pytest.mark.parametrize("ending", ["obj", "ply", "off", "glb"])
@pytest.mark.parametrize("where", [0, 8])
def test_a_vertex_without_a_position_that_no_face_uses_follows_nothing(ending: str, where: int, tmp_path: Path) -> None:
    vertices, faces = np.insert(CORNERS, where, np.nan, axis=0), CUBE + (where == 0)
    rows = [" ".join(f"{each:g}" for each in row) for row in vertices.tolist()]
    text = {
        "obj": "".join(f"v {row}\n" for row in rows) + "".join("f {} {} {}\n".format(*each) for each in faces + 1),
        "ply": "ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
        + "\n".join([*rows, *("3 {} {} {}".format(*each) for each in faces), ""]),
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


# Normals


def card(folder: Path, ending: str) -> Path:
    """A sheet with its own vertices on each side."""
    Mesh(np.vstack([SQUARE, SQUARE]), np.vstack([FRONT, FRONT[:, ::-1] + 4])).save(folder / f"card.{ending}")
    return folder / f"card.{ending}"


@pytest.mark.parametrize("source", ["obj", "ply", "stl", "off", "arrays", "glb"])
def test_both_sides_of_a_sheet_get_the_normals_of_their_faces(source: str, tmp_path: Path) -> None:
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
    assert scene is not None
    (each,) = scene.primitives
    assert each.normals is not None
    own = each.geometry.faces
    for normals, corners in zip(each.normals[own], each.vertices[own], strict=True):
        across = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        assert np.allclose(normals, across / np.linalg.norm(across), atol=1e-6)


def leaf(ending: str, folder: Path) -> Path:
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
def test_normals_of_an_artist_turn_with_the_surface_and_ignore_translations(ending: str, tmp_path: Path) -> None:
    mesh = load(leaf(ending, tmp_path))
    mesh.save(tmp_path / f"shifted.{ending}", mesh.vertices + [0.3, -2.7, 1 / 3])
    assert all((each == (0, 1, 0)).all() for each in normals_of(tmp_path / f"shifted.{ending}"))
    turn = Rotation.from_rotvec([0.4, -0.7, 1.1])
    mesh.save(tmp_path / f"turned.{ending}", turn.apply(mesh.vertices.copy()))
    for each in normals_of(tmp_path / f"turned.{ending}"):
        assert np.allclose(each, turn.apply([0, 1, 0]), atol=1e-6)


def test_the_exact_normals_of_a_ball_stay_exact(tmp_path: Path) -> None:
    phi, theta = np.meshgrid(np.linspace(0.2, np.pi - 0.2, 9), np.linspace(0, 2 * np.pi, 13)[:-1], indexing="ij")
    ball = np.stack([np.sin(phi) * np.cos(theta), np.sin(phi) * np.sin(theta), np.cos(phi)], axis=-1).reshape(-1, 3)
    grid = np.arange(108).reshape(9, 12)
    a, b, c, d = (each.ravel() for each in (grid[:-1], np.roll(grid, -1, 1)[:-1], grid[1:], np.roll(grid, -1, 1)[1:]))
    faces = np.vstack([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])
    gltf = Gltf()
    normals = gltf.accessor(ball, 5126, "VEC3")
    gltf.node(mesh=gltf.mesh("ball", ball, faces, attributes={"NORMAL": normals}))
    mesh = load(write(tmp_path / "ball.glb", gltf.glb()))
    for moved in (mesh.vertices + [1, 2, 3], mesh.vertices * 2):
        mesh.save(tmp_path / "out.glb", moved)
        assert np.array_equal(normals_of(tmp_path / "out.glb")[0], normals_of(tmp_path / "ball.glb")[0])


# glTF: nodes, instances, lines, textures, chunks


@pytest.mark.parametrize(
    "node", [{"scale": [1, 0, 1]}, {"scale": [0, 0, 0]}, {"matrix": [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]
)
@pytest.mark.parametrize("child", [False, True])
def test_an_edit_of_a_flattened_part_is_saved(node: dict, child: bool, tmp_path: Path) -> None:
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
def test_instances_of_a_node_are_parts_that_move_by_themselves(required: bool, tmp_path: Path) -> None:
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


def test_a_hidden_node_is_not_shown_but_saved(tmp_path: Path) -> None:
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
def test_lines_and_points_follow_the_surface_when_saved(first: bool, tmp_path: Path) -> None:
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
    assert scene is not None
    shared, own = (each.vertices for each in scene.strands)
    assert np.allclose(shared, moved, atol=1e-6)
    assert np.allclose(own, moved + 0.01, atol=1e-6)


def picture(mode: str) -> bytes:
    values = np.full((4, 4), 20000, np.uint16)
    image = {
        "I;16": Image.fromarray(values),
        "I": Image.fromarray(values.astype(np.int32)),
        "F": Image.fromarray((values / 65535).astype(np.float32)),
    }[mode]
    stream = io.BytesIO()
    image.save(stream, "PNG" if mode == "I;16" else "TIFF")
    return stream.getvalue()


@pytest.mark.parametrize("mode", ["I;16", "I", "F"])
def test_gray_pictures_of_many_bits_keep_their_gray(mode: str, tmp_path: Path) -> None:
    write(tmp_path / "gray.png", picture(mode))
    write(tmp_path / "a.mtl", "newmtl m\nmap_Kd gray.png\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    assert np.allclose(load(write(tmp_path / "a.obj", text)).vertex_colors()[0, :3], 0.305, atol=0.003)


def test_a_black_surface_that_emits_light_shows_it(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE, material=0))
    gltf.header["materials"] = [
        {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "emissiveFactor": [1, 0, 0]}
    ]
    assert look_of(write(tmp_path / "a.glb", gltf.glb())).materials[0].color == (1, 0, 0, 1)
    write(tmp_path / "a.mtl", "newmtl m\nKd 0 0 0\nKe 0 1 0\n")
    mesh = load(write(tmp_path / "a.obj", "mtllib a.mtl\nusemtl m\n" + obj_cube()))
    assert look_of(mesh).materials[0].color == (0, 1, 0, 1)


@pytest.mark.parametrize("stride", [0, 2, 3])
def test_a_byte_stride_below_four_is_refused_by_name(stride: int, tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    gltf.header["bufferViews"][1]["byteStride"] = stride
    with pytest.raises(ValueError, match=f"bufferView 1 has the byteStride {stride}; glTF permits 4 to 252 bytes"):
        load(write(tmp_path / "a.glb", gltf.glb()))


def test_an_unknown_chunk_of_a_glb_survives(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    chunk = struct.pack("<II", 8, 0x31415926) + b"keep me!"
    data = gltf.glb() + chunk
    mesh = load(write(tmp_path / "a.glb", data[:8] + struct.pack("<I", len(data)) + data[12:]))
    mesh.save(tmp_path / "moved.glb", mesh.vertices * 2)
    assert (tmp_path / "moved.glb").read_bytes().endswith(chunk)
