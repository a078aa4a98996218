"""Files from strangers: nothing private is read or written, nothing waits, counts are bounded before allocation."""

import base64
import io
import json
import os

import numpy as np
import pytest
from mesh_files import checkered, header_and_data, look_of, obj_cube, textured_quad, write
from PIL import Image

from dfd.mesh.file import assets
from dfd.mesh.mesh import load

SECRET = b"-----BEGIN OPENSSH PRIVATE KEY----- secret"


def outside(tmp_path, change):
    """A glTF file of a textured square with its data and its picture in files beside it, changed."""
    gltf = textured_quad(tmp_path)
    write(tmp_path / "data.bin", gltf.data)
    gltf.header["buffers"] = [{"uri": "data.bin", "byteLength": len(gltf.data)}]
    gltf.header["images"] = [{"uri": "paint.png"}]
    change(gltf.header)
    return write(tmp_path / "quad.gltf", json.dumps(gltf.header))


def private(tmp_path, name):
    (tmp_path / name).parent.mkdir(exist_ok=True)
    return write(tmp_path / name, SECRET + bytes(2000))


@pytest.mark.parametrize("name", ["notes.txt", ".ssh/id_rsa", "keys.png", "%2Essh/id_rsa"])
def test_private_files_are_not_saved(name, tmp_path):
    private(tmp_path, name.replace("%2E", "."))

    def add(header):
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
def test_what_is_shown_as_a_picture_must_be_one(name, slot, tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    private(folder, name)
    if name == "../above.png":
        checkered(tmp_path / "above.png")

    def show(header):
        header["images"].append({"uri": name})
        header["textures"].append({"source": 1})
        owner = header["materials"][0]
        (owner["pbrMetallicRoughness"] if slot == "baseColorTexture" else owner)[slot] = {"index": 1}

    path = outside(folder, show)
    if slot == "baseColorTexture":
        with pytest.warns(UserWarning, match="could not be read; affected faces are gray"):
            mesh = load(path)
        assert mesh.appearance is None
    else:
        mesh = load(path)
    mesh.save(tmp_path / "out.glb", mesh.vertices + 1)
    assert b"PRIVATE KEY" not in (tmp_path / "out.glb").read_bytes()
    assert header_and_data(tmp_path / "out.glb")[0]["images"][1] == {"uri": name}


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    path = outside(folder, lambda header: None)
    (folder / "data.bin").rename(tmp_path / "data.bin")
    (folder / "data.bin").symlink_to(tmp_path / "data.bin")
    with pytest.raises(ValueError, match="names 'data.bin', which lies outside the folder of the file"):
        load(path)


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_pipes_and_devices_are_refused_and_not_waited_for(kind, tmp_path):
    def put(name):
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


def large_picture(width, height):
    stream = io.BytesIO()
    Image.new("1", (width, height)).save(stream, "PNG")
    return stream.getvalue()


def test_a_picture_too_large_to_decode_is_gray(tmp_path):
    gltf = textured_quad(tmp_path)
    gltf.header["images"][0]["bufferView"] = gltf.view(large_picture(12_000, 12_000))
    path = write(tmp_path / "bomb.glb", gltf.glb())
    assert path.stat().st_size < 200_000
    with pytest.warns(UserWarning, match="the texture of material 'paint', which could not be read"):
        mesh = load(path)
    assert mesh.appearance is None


def test_all_pictures_of_a_file_share_one_budget(tmp_path, monkeypatch):
    monkeypatch.setattr(assets, "MOST_TEXELS", 100)
    materials, faces = [], []
    for number in range(3):
        Image.new("RGB", (6, 6), (number, 0, 0)).save(tmp_path / f"{number}.png")
        materials.append(f"newmtl m{number}\nmap_Kd {number}.png\n")
        faces.append(f"usemtl m{number}\nf 1/1 2/1 {number + 3}/1\n")
    write(tmp_path / "cube.mtl", "".join(materials))
    with pytest.warns(UserWarning, match=r"names 2\.png, which could not be read"):
        look = load(write(tmp_path / "cube.obj", "mtllib cube.mtl\nvt 0 0\n" + obj_cube() + "".join(faces))).appearance
    assert [each.texture is None for each in look.materials].count(False) == 2


# --- what is written beside an OBJ file ---


TEXT = "password = hunter2\n"


def stranger(folder, library, content):
    folder.mkdir()
    write(folder / library, content)
    return load(write(folder / "chair.obj", f"mtllib {library}\n" + obj_cube().replace("f ", "usemtl wood\nf ", 1)))


def test_only_used_materials_are_written_under_the_name_of_the_file(tmp_path):
    mesh = stranger(tmp_path / "in", "json.py", TEXT + "newmtl wood\nKd 1 0 0\nnewmtl other\nKd 0 1 0\n")
    (tmp_path / "out").mkdir()
    mesh.save(tmp_path / "out" / "chair.obj", mesh.vertices + 1)
    assert {each.name for each in (tmp_path / "out").iterdir()} == {"chair.obj", "chair.mtl"}
    assert (tmp_path / "out" / "chair.mtl").read_text().split() == ["newmtl", "wood", "Kd", "1", "0", "0"]
    assert "json.py" not in (tmp_path / "out" / "chair.obj").read_text()
    assert any(each.color == (1, 0, 0, 1) for each in look_of(tmp_path / "out" / "chair.obj").materials)


def test_a_picture_is_written_under_the_name_of_one(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    checkered(folder / "paint.png").rename(folder / "json.py")
    (folder / "a.mtl").write_text("newmtl wood\nmap_Kd json.py\n")
    text = "mtllib a.mtl\nvt 0 0\n" + obj_cube().replace("f ", "usemtl wood\nf ", 1)
    mesh = load(write(folder / "chair.obj", text))
    (tmp_path / "out").mkdir()
    mesh.save(tmp_path / "out" / "chair.obj", mesh.vertices + 1)
    assert {each.name for each in (tmp_path / "out").iterdir()} == {"chair.obj", "chair.mtl", "json.png"}


@pytest.mark.parametrize("kind", ["obj", "glb"])
def test_materials_of_another_file_are_never_overwritten(kind, tmp_path):
    if kind == "glb":
        mesh = load(write(tmp_path / "quad.glb", textured_quad(tmp_path).glb()))
    else:
        mesh = stranger(tmp_path / "in", "a.mtl", "newmtl wood\nKd 1 0 0\n")
    (tmp_path / "to").mkdir()
    out = tmp_path / "to" / "out.obj"
    write(out.with_suffix(".mtl"), "newmtl mine\nKd 0 0 1\n")
    for _ in range(2):  # written once more it keeps to its own names
        mesh.save(out, mesh.vertices + 1)
        assert out.with_suffix(".mtl").read_text() == "newmtl mine\nKd 0 0 1\n"
        assert "mtllib out_2.mtl" in out.read_text()
        assert sorted(each.name for each in out.parent.glob("*.mtl")) == ["out.mtl", "out_2.mtl"]
    assert look_of(out)
