"""Test uploads: a mesh is stored with its materials and textures, and no name leads outside the folder."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mesh_files import Gltf
from PIL import Image

import dfd
from dfd.app.options import OpenedFile, read_shape
from dfd.app.session.kept_edits import upload_folder
from dfd.app.web.uploads import MOST_FILES, receive

OBJ = b"mtllib looks.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
MTL = b"newmtl red\nKd 1 0 0\n"


def named(content: dict[str, bytes]) -> list[tuple[str, io.BytesIO]]:
    return [(name, io.BytesIO(data)) for name, data in content.items()]


def zipped(content: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return stream.getvalue()


def everything_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize("packed", [False, True])
def test_an_obj_finds_its_materials(tmp_path: Path, packed: bool) -> None:
    content = {"a/tri.obj": OBJ, "a/looks.mtl": MTL, "a/tex/wood.png": b"x"}
    if packed:
        content = {"tri.zip": zipped({**content, "__MACOSX/a/._tri.obj": b"junk", "./": b""})}
    upload = receive(named(content), tmp_path, 10_000)
    assert upload.mesh.name == "tri.obj"
    assert "tri" not in upload.mesh.path.name
    looks = dfd.load(upload.mesh.path).appearance
    assert looks.materials[0].color == (1.0, 0.0, 0.0, 1.0)
    assert (upload.mesh.path.parent / "tex" / "wood.png").read_bytes() == b"x"


def test_mesh_field_and_edit_together(tmp_path: Path) -> None:
    upload = receive(named({"m.stl": b"m", "f.safetensors": b"f", "e.json": b"{}"}), tmp_path, 100)
    assert upload.field.path.read_bytes() == b"f"
    assert receive(named({"F.SAFETENSORS": b"f"}), tmp_path, 100).mesh is None
    several = receive(named({"m.stl": b"m", "a.json": b"{}", "b.json": b"{}"}), tmp_path, 100)
    assert several.edit is None, "they belong to the mesh"


NAMES = ["../../evil", "/etc/evil", "..\\..\\evil", "C:\\evil", ".a", "x" * 300, "‮evil", "a/../../b", "con\n"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("packed", [False, True])
def test_a_name_leads_nowhere(tmp_path: Path, name: str, packed: bool) -> None:
    """The opened file gets another name, and files with unsafe names are left out."""
    inside = tmp_path / "session"
    content = {f"{name}.obj": OBJ, f"{name}.png": b"evil"}
    upload = receive(named({"a.zip": zipped(content)} if packed else content), inside, 10_000)
    assert upload.mesh.path.resolve().is_relative_to(inside)
    assert everything_in(tmp_path) == [upload.mesh.path.name]


def test_an_uploaded_obj_reads_nothing_outside_its_folder(tmp_path: Path) -> None:
    (tmp_path / "secret.mtl").write_bytes(MTL)
    obj = OBJ.replace(b"looks.mtl", b"../../secret.mtl")
    upload = receive(named({"tri.obj": obj}), tmp_path / "session", 1000)
    assert (upload.mesh.path.parent / "../../secret.mtl").is_file()
    with pytest.warns(UserWarning, match="could not be read"):
        assert dfd.load(upload.mesh.path).appearance is None


# Files that a mesh names


def picture(red: int = 255) -> bytes:
    stream = io.BytesIO()
    Image.new("RGB", (4, 4), (red, 0, 0)).save(stream, "PNG")
    return stream.getvalue()


def textured(name: str, library: str = "looks.mtl") -> dict[str, bytes]:
    obj = f"mtllib {library}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n"
    return {"m.obj": obj.encode(), "looks.mtl": f"newmtl m\nmap_Kd {name}\n".encode()}


def scene(uri: str) -> tuple[bytes, bytes]:
    """A glTF file whose buffer is scene.bin, and whose texture is `uri`."""
    gltf = Gltf()
    uv = gltf.accessor(np.zeros((3, 2)), 5126, "VEC2")
    gltf.node(mesh=gltf.mesh("t", np.eye(3), [(0, 1, 2)], attributes={"TEXCOORD_0": uv}, material=0))
    gltf.header["buffers"] = [{"byteLength": len(gltf.data), "uri": "scene.bin"}]
    gltf.header |= {"images": [{"uri": uri}], "textures": [{"source": 0}]}
    gltf.header["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    return json.dumps(gltf.header).encode(), gltf.data


RED_MESHES = {
    "a number sign": {**textured("a#1.png"), "a#1.png": picture()},
    "a percent sign": {**textured("50% a&b!.png"), "50% a&b!.png": picture()},
    "loose": {"m.gltf": scene("textures/a.png")[0], "scene.bin": scene("")[1], "a.png": picture()},
    "an escaped name": {"m.gltf": scene("textures/a%231.png")[0], "scene.bin": scene("")[1], "a#1.png": picture()},
    "a dropped folder": {f"f/{name}": data for name, data in {**textured("t/a.png"), "t/a.png": picture()}.items()},
    "source and textures": {
        "x/source/m.obj": textured("a.png")["m.obj"],
        "x/source/looks.mtl": textured("a.png")["looks.mtl"],
        "x/textures/a.png": picture(),
    },
    "a folder above": {
        "source/m.obj": textured("../textures/a.png")["m.obj"],
        "source/looks.mtl": textured("../textures/a.png")["looks.mtl"],
        "textures/a.png": picture(),
    },
    "another case": {**textured("Textures/A.PNG", "Looks.MTL"), "textures/a.png": picture()},
    "a path of another machine": {**textured("C:\\Users\\me\\a.png"), "a.png": picture()},
    "two of one name": {**textured("b/a.png"), "a/a.png": picture(0), "c/b/a.png": picture(), "d/a.png": picture(0)},
    "attributes of macOS": {
        **textured("a.png"),
        "a.png": picture(),
        "._m.obj": b"x",
        "._a.png": b"x",
        ".DS_Store": b"x",
    },
}


@pytest.mark.parametrize("name", RED_MESHES)
@pytest.mark.parametrize("packed", [False, True])
def test_textures_are_found_by_path_or_else_by_name(name: str, packed: bool, tmp_path: Path) -> None:
    content = RED_MESHES[name]
    upload = receive(named({"a.zip": zipped(content)} if packed else content), tmp_path, 100_000)
    mesh, warnings = read_shape(upload.mesh)
    assert warnings == []
    assert np.allclose(mesh.vertex_colors(), (1, 0, 0, 1))
    (tmp_path / "out").mkdir()
    mesh.save(tmp_path / "out" / f"o{upload.mesh.path.suffix}", mesh.vertices * 2)
    assert np.allclose(dfd.load(tmp_path / "out" / f"o{upload.mesh.path.suffix}").vertex_colors(), (1, 0, 0, 1))


def test_a_stored_upload_finds_its_textures_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DFD_DATA", str(tmp_path))
    upload = receive(named(RED_MESHES["a folder above"]), tmp_path / "edits" / "key", 100_000)
    assert upload_folder(upload.mesh.path) == upload.folder
    stored = OpenedFile("m.obj", upload.mesh.path, upload_folder(upload.mesh.path))
    assert np.allclose(read_shape(stored)[0].vertex_colors(), (1, 0, 0, 1))
    assert upload_folder(tmp_path / "a.obj") is None
    assert upload_folder(tmp_path / "edits" / "key.json") is None


def broken(position: int) -> bytes:
    """Return a ZIP file with one changed byte in its compressed data."""
    data = bytearray(zipped({"a.obj": OBJ * 20}))
    data[position] ^= 0xFF
    return bytes(data)


DAMAGED = [b"", b"PK", b"no zip at all", zipped({"a.obj": OBJ})[:-30], broken(36), broken(60)]
CLASHES = [("a", "a/b.obj"), ("a/b.obj", "a"), ("a.obj", "./a.obj")]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"a.obj": OBJ, "b.obj": OBJ}, "Open one .obj file at a time, got a.obj, b.obj"),
        ({"a.png": b"x"}, "^a.png cannot be opened: open OBJ, PLY, STL, OFF, glTF or GLB; convert FBX with Blender$"),
        ({"a.json": b"x", "b.json": b"x"}, "Open one .json file at a time"),
        ({"a.zip": zipped({"b/c.zip": zipped({"a.obj": OBJ})})}, "c.zip is a ZIP file in a ZIP file: unpack it"),
        ({"": b"x"}, "cannot be opened: open OBJ"),
        ({}, "^An upload without files cannot be opened"),
        ({"a.obj": b"x" * 1_000_001}, "larger than this server takes"),
        ({"a.zip": zipped({"a.obj": b"\0" * 10_000_000})}, "larger than this server takes"),
        ({f"{i}.png": b"" for i in range(MOST_FILES + 1)}, f"at most {MOST_FILES} files"),
        *(({"a.zip": data}, "is damaged or not a zip") for data in DAMAGED),
        *(({"a.zip": zipped(dict.fromkeys(names, OBJ))}, "must have each file once") for names in CLASHES),
    ],
)
def test_what_cannot_be_opened_is_refused_and_leaves_nothing(
    tmp_path: Path, content: dict[str, bytes], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as refused:
        receive(named(content), tmp_path / "session", 1_000_000)
    assert str(tmp_path) not in str(refused.value)
    assert everything_in(tmp_path) == []
