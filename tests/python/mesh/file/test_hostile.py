"""Files from strangers: nothing private is read or written, nothing waits, counts are bounded before allocation."""

from __future__ import annotations

import base64
import io
import json
import os
import struct
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, checkered, header_and_data, obj_cube, textured_quad, write
from PIL import Image

from dfd.mesh.file import images
from dfd.mesh.mesh import Mesh, load

SECRET = b"-----BEGIN OPENSSH PRIVATE KEY----- secret"


def outside(tmp_path: Path, change: Any) -> Path:
    """A glTF file of a textured square with its data and its picture in files beside it, changed."""
    gltf = textured_quad(tmp_path)
    write(tmp_path / "data.bin", gltf.data)
    gltf.header["buffers"] = [{"uri": "data.bin", "byteLength": len(gltf.data)}]
    gltf.header["images"] = [{"uri": "paint.png"}]
    change(gltf.header)
    return write(tmp_path / "quad.gltf", json.dumps(gltf.header))


def private(tmp_path: Path, name: str) -> Path:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    return write(tmp_path / name, SECRET + bytes(2000))


@pytest.mark.parametrize("name", ["notes.txt", ".ssh/id_rsa", "keys.png", "%2Essh/id_rsa"])
def test_files_that_nothing_shows_are_neither_read_nor_saved(name: str, tmp_path: Path) -> None:
    private(tmp_path, name.replace("%2E", "."))

    def add(header: dict) -> None:
        header["images"].append({"uri": name})
        header["buffers"].append({"uri": name, "byteLength": 100})
        header["bufferViews"].append({"buffer": 1, "byteLength": 100})
        header["accessors"].append(
            {"bufferView": len(header["bufferViews"]) - 1, "count": 100, "componentType": 5121, "type": "SCALAR"}
        )
        header["textures"].append({"source": 1})
        header["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}})

    mesh = load(outside(tmp_path, add))
    for ending in ("glb", "gltf"):
        out = tmp_path / f"out.{ending}"
        mesh.save(out, mesh.vertices + 1)
        content = out.read_bytes()
        assert b"PRIVATE KEY" not in content
        assert base64.b64encode(SECRET)[:30] not in content
        assert np.array_equal(load(out).vertices, mesh.vertices + 1)
    header, data = header_and_data(tmp_path / "out.glb")
    assert (tmp_path / "paint.png").read_bytes() in data  # what is shown comes along
    assert [image.get("uri") for image in header["images"]] == [None, name]
    assert [buffer.get("uri") for buffer in header["buffers"]] == [None, name]


@pytest.mark.parametrize("name", ["notes.txt", ".ssh/id_rsa", "keys.png", "../above.png"])
@pytest.mark.parametrize("slot", ["baseColorTexture", "normalTexture"])
def test_what_is_shown_as_a_picture_must_be_one(name: str, slot: str, tmp_path: Path) -> None:
    folder = tmp_path / "inside"
    folder.mkdir()
    private(folder, name)
    if name == "../above.png":
        checkered(tmp_path / "above.png")

    def show(header: dict) -> None:
        header["images"].append({"uri": name})
        header["textures"].append({"source": 1})
        owner = header["materials"][0]
        (owner["pbrMetallicRoughness"] if slot == "baseColorTexture" else owner)[slot] = {"index": 1}

    path = outside(folder, show)
    if slot == "baseColorTexture":
        with pytest.warns(UserWarning, match="could not be read; what it would color is gray"):
            mesh = load(path)
        assert mesh.appearance is None
    else:
        mesh = load(path)
    mesh.save(tmp_path / "out.glb", mesh.vertices + 1)
    assert b"PRIVATE KEY" not in (tmp_path / "out.glb").read_bytes()
    assert header_and_data(tmp_path / "out.glb")[0]["images"][1] == {"uri": name}


def test_data_in_a_hidden_file_is_refused(tmp_path: Path) -> None:
    private(tmp_path, ".ssh/id_rsa")
    path = outside(tmp_path, lambda header: header["buffers"][0].update(uri=".ssh/id_rsa"))
    with pytest.raises(ValueError, match="'.ssh/id_rsa' is a hidden file"):
        load(path)


def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    folder = tmp_path / "inside"
    folder.mkdir()
    path = outside(folder, lambda header: None)
    (folder / "data.bin").rename(tmp_path / "data.bin")
    (folder / "data.bin").symlink_to(tmp_path / "data.bin")
    with pytest.raises(ValueError, match="'data.bin' lies outside the folder of the file"):
        load(path)


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_pipes_and_devices_are_refused_and_not_waited_for(kind: str, tmp_path: Path) -> None:
    def put(name: str) -> None:
        (tmp_path / name).unlink(missing_ok=True)
        if kind == "pipe":
            os.mkfifo(tmp_path / name)
        else:
            (tmp_path / name).symlink_to("/dev/zero")

    path = outside(tmp_path, lambda header: None)
    put("paint.png")
    with pytest.warns(UserWarning, match="paint.png"):
        assert load(path).appearance is None
    put("data.bin")
    with pytest.raises(ValueError, match=r"it is not a file|lies outside"):
        load(path)
    put("mesh.obj")
    with pytest.raises(OSError, match="could not be read: it is not a file"):
        load(tmp_path / "mesh.obj")


# --- pictures ---


def large_picture(width: int, height: int) -> bytes:
    stream = io.BytesIO()
    Image.new("1", (width, height)).save(stream, "PNG")
    return stream.getvalue()


def test_a_picture_too_large_to_decode_is_gray(tmp_path: Path) -> None:
    gltf = textured_quad(tmp_path)
    gltf.header["images"][0]["bufferView"] = gltf.view(large_picture(12_000, 12_000))
    path = write(tmp_path / "bomb.glb", gltf.glb())
    assert path.stat().st_size < 200_000
    with pytest.warns(UserWarning, match="the texture of material 'paint', which could not be read"):
        mesh = load(path)
    assert mesh.appearance is None


def test_a_picture_is_decoded_once_however_often_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded = []
    original = images._decoded
    monkeypatch.setattr(images, "_decoded", lambda data: decoded.append(len(data)) or original(data))
    gltf = textured_quad(tmp_path)
    paint = gltf.header["images"][0]
    primitive = gltf.header["meshes"][0]["primitives"][0]
    for number in range(1, 60):
        gltf.header["images"].append(dict(paint))
        gltf.header["textures"].append({"source": number})
        gltf.header["materials"].append({"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}})
        gltf.header["meshes"][0]["primitives"].append({**primitive, "material": number})
    look = load(write(tmp_path / "many.glb", gltf.glb())).appearance
    assert look is not None
    assert len(look.materials) == 60
    assert len({id(each.texture) for each in look.materials}) == 1
    assert len(decoded) == 1


def test_all_pictures_of_a_file_share_one_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(images, "MOST_TEXELS", 100)
    materials, faces = [], []
    for number in range(3):
        Image.new("RGB", (6, 6), (number, 0, 0)).save(tmp_path / f"{number}.png")
        materials.append(f"newmtl m{number}\nmap_Kd {number}.png\n")
        faces.append(f"usemtl m{number}\nf 1/1 2/1 {number + 3}/1\n")
    write(tmp_path / "cube.mtl", "".join(materials))
    with pytest.warns(UserWarning, match=r"names 2\.png, which could not be read"):
        look = load(write(tmp_path / "cube.obj", "mtllib cube.mtl\nvt 0 0\n" + obj_cube() + "".join(faces))).appearance
    assert look is not None
    assert [each.texture is None for each in look.materials].count(False) == 2


# --- counts ---


def test_cut_off_text_files_are_refused_wherever_they_end(tmp_path: Path) -> None:
    Mesh(CORNERS, CUBE).save(tmp_path / "whole.off")
    header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    body = [" ".join(f"{each:g}" for each in corner) for corner in CORNERS] + [
        "3 " + " ".join(map(str, face)) for face in CUBE
    ]
    write(tmp_path / "whole.ply", header + "\n".join(body) + "\n")
    for ending in ("off", "ply"):
        lines = (tmp_path / f"whole.{ending}").read_text().splitlines(keepends=True)
        assert len(load(tmp_path / f"whole.{ending}").faces) == 12
        for kept in range(len(lines) - 20, len(lines)):
            with pytest.raises(ValueError, match="is cut off"):
                load(write(tmp_path / f"cut.{ending}", "".join(lines[:kept])))
        short = "".join(lines).rstrip().rsplit(" ", 1)[0]
        with pytest.raises(ValueError, match="face 11 should have 3 corners, but 2 are there|is cut off"):
            load(write(tmp_path / f"cut.{ending}", short))
    edge = "".join((tmp_path / "whole.off").read_text().splitlines(keepends=True)[:-1]) + "2 0 1\n"
    with pytest.raises(ValueError, match="face 11 has '2' corners, and 3 are needed"):
        load(write(tmp_path / "edge.off", edge))


def test_a_cut_off_binary_stl_says_what_is_missing(tmp_path: Path) -> None:
    Mesh(CORNERS, CUBE).save(tmp_path / "whole.stl")
    data = (tmp_path / "whole.stl").read_bytes()
    with pytest.raises(ValueError, match="it should have 12 faces in 684 bytes, but 600 are there"):
        load(write(tmp_path / "cut.stl", data[:600]))


@pytest.mark.parametrize("letters", [b"caf\xe9", b"\x83e\x83X\x83g", b"\xff\xfe\x00"])
def test_letters_in_no_encoding_need_no_other_package(
    letters: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("charset_normalizer", "chardet"):
        monkeypatch.setitem(sys.modules, package, None)
    Mesh(CORNERS, CUBE).save(tmp_path / "cube.off")
    off = (tmp_path / "cube.off").read_bytes().replace(b"OFF\n", b"OFF\n# " + letters + b"\n", 1)
    facets = b"".join(
        b"facet normal 0 0 0\nouter loop\n"
        + b"".join(b"vertex %g %g %g\n" % tuple(CORNERS[corner]) for corner in face)
        + b"endloop\nendfacet\n"
        for face in CUBE
    )
    header = b"ply\nformat ascii 1.0\ncomment " + letters + b"\nelement vertex 8\nproperty float x\nproperty float y\n"
    header += b"property float z\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [b"%g %g %g" % tuple(corner) for corner in CORNERS] + [b"3 %d %d %d" % tuple(face) for face in CUBE]
    files = {
        "cube.off": off,
        "cube.stl": b"solid " + letters + b"\n" + facets + b"endsolid\n",
        "cube.ply": header + b"\n".join(rows),
        "cube.obj": b"# " + letters + b"\n" + obj_cube().encode(),
    }
    for name, content in files.items():
        assert len(load(write(tmp_path / name, content)).faces) == 12
    for length in range(84, 684, 37):  # nor does the rest of a binary file
        binary = tmp_path / "whole.stl"
        Mesh(CORNERS + 0.1, CUBE).save(binary)
        with pytest.raises(ValueError, match="not a well-formed STL file"):
            load(write(tmp_path / "cut.stl", binary.read_bytes()[:length]))


def test_three_hundred_nodes_of_three_hundred_primitives(tmp_path: Path) -> None:
    gltf = Gltf()
    mesh_index = gltf.mesh("cube", CORNERS, CUBE)
    gltf.header["meshes"][mesh_index]["primitives"] *= 300
    for i in range(300):
        gltf.node(mesh=mesh_index, translation=[2 * i, 0, 0])
    path = write(tmp_path / "many.glb", gltf.glb())
    mesh = load(path)
    assert (mesh.part_count, len(mesh.faces), len(mesh.vertices)) == (300, 300 * 300 * 12, 300 * 8)


# --- headers of other types ---


@pytest.mark.parametrize(
    "change",
    [
        lambda h: h["materials"][0]["pbrMetallicRoughness"].update(baseColorTexture=5),
        lambda h: h["materials"][0]["pbrMetallicRoughness"].update(baseColorTexture={"index": "0"}),
        lambda h: h["materials"][0].update(pbrMetallicRoughness=[1]),
        lambda h: h["materials"][0]["pbrMetallicRoughness"].update(baseColorFactor="red"),
        lambda h: h["materials"][0].update(alphaMode=[], alphaCutoff={}),
        lambda h: h["materials"][0].update(extensions=[]),
        lambda h: h["textures"][0].update(sampler=[], source={}),
        lambda h: h["textures"][0].update(extensions={"KHR_texture_basisu": 5}),
        lambda h: h.update(samplers=5),
        lambda h: h.update(textures=7),
        lambda h: h.update(images={"a": 1}),
        lambda h: h.update(skins="no", animations=3),
        lambda h: h.update(materials=None),
        lambda h: h["images"][0].update(uri=5),
        lambda h: h["images"][0].update(bufferView=1e9),
        lambda h: h["nodes"][0].update(mesh="0"),
        lambda h: h["nodes"][0].update(mesh=[]),
        lambda h: h["nodes"][0].update(rotation=[0, 0, 0, "1"]),
        lambda h: h["nodes"][0].update(matrix=5),
        lambda h: h["nodes"][0].update(name={"a": []}),
        lambda h: h["meshes"][0].update(primitives=5),
        lambda h: h["meshes"][0]["primitives"][0].update(mode=[], material=[]),
        lambda h: h["meshes"][0]["primitives"][0].update(targets=5),
        lambda h: h["meshes"][0]["primitives"][0].update(extensions={"KHR_draco_mesh_compression": {}}),
        lambda h: h["meshes"][0]["primitives"][0]["attributes"].update(NORMAL=99, COLOR_0="x", TEXCOORD_0=[]),
        lambda h: h["accessors"][0].update(sparse=5),
        lambda h: h["accessors"][0].update(sparse={"count": 1, "indices": {"bufferView": 99}, "values": {}}),
        lambda h: h["bufferViews"][0].update(extensions={"EXT_meshopt_compression": {"buffer": 0}}),
        lambda h: h.update(scenes=[{"nodes": 5}]),
        lambda h: h.update(scenes=[], scene=3),
        lambda h: h.update(asset=[]),
    ],
)
def test_values_of_another_type_give_a_mesh_or_one_error(change: Any, tmp_path: Path) -> None:
    gltf = textured_quad(tmp_path)
    change(gltf.header)
    path = write(tmp_path / "odd.glb", gltf.glb())
    mesh = refused = None
    try:
        mesh = load_quietly(path)
    except ValueError as error:
        refused = str(error)
    if mesh is None:
        assert refused is not None
        assert refused.count(str(path)) == 1
        assert "\n" not in refused
        return
    mesh.save(tmp_path / "out.glb", mesh.vertices + 1)
    assert np.array_equal(load_quietly(tmp_path / "out.glb").vertices, mesh.vertices + 1)


def load_quietly(path: Path) -> Mesh:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load(path)


def test_deep_values_are_refused_before_they_could_fail_to_be_saved(tmp_path: Path) -> None:
    for depth, fails in ((150, False), (900, True)):
        gltf = textured_quad(tmp_path)
        deep: Any = 0
        for _ in range(depth):
            deep = [deep]
        gltf.header["extras"] = deep
        path = write(tmp_path / "deep.glb", gltf.glb())
        if fails:
            with pytest.raises(ValueError, match="its values are nested more than 200 deep"):
                load(path)
        else:
            load(path).save(tmp_path / "out.glb", load(path).vertices + 1)
            assert header_and_data(tmp_path / "out.glb")[0]["extras"] == deep


def test_messages_do_not_quote_what_is_long(tmp_path: Path) -> None:
    uri = "data:image/png;base64," + base64.b64encode(b"no picture" * 5000).decode()
    with pytest.warns(UserWarning, match="a data URI of 66690 characters") as caught:
        look = load(outside(tmp_path, lambda header: header["images"][0].update(uri=uri))).appearance
    assert look is None
    assert len(str(caught[0].message)) < 400
    with pytest.raises(ValueError, match="a data URI of") as refused:
        load(outside(tmp_path, lambda header: header["buffers"][0].update(uri=uri.replace("base64", "text"))))
    assert len(str(refused.value)) < 400
    with pytest.raises(ValueError, match=r"has count 'x+… \(100002 characters\)") as refused:
        load(outside(tmp_path, lambda header: header["accessors"][0].update(count="x" * 100_000)))
    assert len(str(refused.value)) < 400


def test_views_of_a_compressed_buffer_are_bounded(tmp_path: Path) -> None:
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh("cube", CORNERS, CUBE))
    size = 2**32
    gltf.header["buffers"] = [
        {"byteLength": len(gltf.data)},
        {"byteLength": size, "extensions": {"EXT_meshopt_compression": {"fallback": True}}},
    ]
    packed = {"buffer": 0, "byteLength": 100, "byteStride": 16, "count": size // 16, "mode": "ATTRIBUTES"}
    gltf.header["bufferViews"][0] = {
        "buffer": 1,
        "byteLength": size,
        "byteStride": 16,
        "extensions": {"EXT_meshopt_compression": packed},
    }
    text = json.dumps(gltf.header).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(gltf.data), 0x004E4942) + gltf.data
    )
    path = write(tmp_path / "views.glb", struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    with pytest.raises(ValueError, match=r"add up to 4294967296 bytes of|its bufferViews add up to"):
        load(path)
