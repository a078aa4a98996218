"""Uploads: what belongs together stays together, and no name leads anywhere else."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import pytest

import dfd
from dfd.app.web.uploads import MOST_FILES, UploadedFile, receive

OBJ = b"mtllib looks.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
MTL = b"newmtl red\nKd 1 0 0\n"


def files(**content: bytes) -> list[UploadedFile]:
    return [UploadedFile(name, io.BytesIO(data)) for name, data in content.items()]


def named(content: dict[str, bytes]) -> list[UploadedFile]:
    return files(**content)


def zipped(content: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return stream.getvalue()


def everything_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def test_an_obj_finds_its_materials(tmp_path: Path) -> None:
    upload = receive(named({"tri.obj": OBJ, "looks.mtl": MTL}), tmp_path, 1000)
    assert upload.mesh is not None
    assert upload.mesh.name == "tri.obj"
    assert upload.mesh.path is not None
    assert "tri" not in upload.mesh.path.name
    looks = dfd.load(upload.mesh.path).appearance
    assert looks is not None
    assert looks.materials[0].color == (1.0, 0.0, 0.0, 1.0)


def test_a_zip_is_its_files(tmp_path: Path) -> None:
    archive = zipped({"a/tri.obj": OBJ, "a/looks.mtl": MTL, "__MACOSX/a/._tri.obj": b"junk", "a/tex/wood.png": b"x"})
    upload = receive(named({"tri.zip": archive}), tmp_path, 10_000)
    assert upload.mesh is not None
    assert upload.mesh.path is not None
    assert dfd.load(upload.mesh.path).appearance is not None
    assert (upload.mesh.path.parent / "tex" / "wood.png").read_bytes() == b"x"


def test_mesh_field_and_edit_together(tmp_path: Path) -> None:
    upload = receive(named({"m.stl": b"m", "f.safetensors": b"f", "e.json": b"{}"}), tmp_path, 100)
    assert upload.field is not None
    assert upload.edit is not None
    assert upload.field.path.read_bytes() == b"f"
    assert receive(named({"F.SAFETENSORS": b"f"}), tmp_path, 100).mesh is None
    assert receive(named({"e.json": b"{}"}), tmp_path, 100).field is None


@pytest.mark.parametrize(
    "name",
    [
        "../../evil.obj",
        "/etc/evil.obj",
        "..\\..\\evil.obj",
        "C:\\evil.obj",
        ".obj.obj",
        "a\0b.obj",
        "x" * 300 + ".obj",
        "‮evil.obj",
    ],
)
def test_a_name_leads_nowhere(tmp_path: Path, name: str) -> None:
    inside = tmp_path / "session"
    upload = receive(named({name: OBJ}), inside, 1000)
    assert upload.mesh is not None
    assert upload.mesh.path is not None
    assert upload.mesh.path.resolve().is_relative_to(inside)
    assert everything_in(tmp_path) == [upload.mesh.path.name]


@pytest.mark.parametrize("name", ["../evil.png", "/etc/evil.png", "..", ".hidden", "a/../../b.png", "con\n.png"])
def test_what_nobody_needs_under_a_harmful_name_is_left_out(tmp_path: Path, name: str) -> None:
    receive(named({"tri.obj": OBJ, name: b"evil"}), tmp_path / "session", 1000)
    assert len(everything_in(tmp_path)) == 1


@pytest.mark.parametrize("name", ["../evil.obj", "/etc/evil.obj", "a/../../evil.obj", "..\\evil.obj", "C:/evil.obj"])
def test_a_zip_that_leads_outside_is_refused_whole(tmp_path: Path, name: str) -> None:
    archive = zipped({"tri.obj": OBJ, name: OBJ})
    with pytest.raises(ValueError, match="names a place outside itself"):
        receive(named({"tri.zip": archive}), tmp_path / "session", 10_000)
    assert everything_in(tmp_path) == []


def test_an_uploaded_obj_reads_nothing_outside_its_folder(tmp_path: Path) -> None:
    (tmp_path / "secret.mtl").write_bytes(MTL)
    obj = OBJ.replace(b"looks.mtl", b"../../secret.mtl")
    upload = receive(named({"tri.obj": obj}), tmp_path / "session", 1000)
    assert upload.mesh is not None
    assert upload.mesh.path is not None
    secret = upload.mesh.path.parent / "../../secret.mtl"
    assert secret.is_file()
    with pytest.warns(UserWarning, match="could not be read"):
        assert dfd.load(upload.mesh.path).appearance is None


def test_too_much_is_refused_whatever_it_claims(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="larger than this server takes"):
        receive(named({"a.obj": b"x" * 101}), tmp_path, 100)
    bomb = zipped({"a.obj": b"\0" * 10_000_000})
    assert len(bomb) < 20_000
    with pytest.raises(ValueError, match="larger than this server takes"):
        receive(named({"a.zip": bomb}), tmp_path, 1_000_000)
    with pytest.raises(ValueError, match=f"at most {MOST_FILES} files"):
        receive(named({f"{i}.png": b"" for i in range(MOST_FILES + 1)}), tmp_path, 100)
    assert everything_in(tmp_path) == []


def broken(position: int) -> bytes:
    """A zip with another byte in the compressed data of its file."""
    data = bytearray(zipped({"a.obj": OBJ * 20}))
    data[position] ^= 0xFF
    return bytes(data)


@pytest.mark.parametrize("data", [b"", b"PK", b"no zip at all", zipped({"a.obj": OBJ})[:-30], broken(36), broken(60)])
def test_a_damaged_zip(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(ValueError, match="is damaged or not a zip"):
        receive(named({"a.zip": data}), tmp_path, 1000)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"a.obj": OBJ, "b.obj": OBJ}, "Open one mesh at a time, got a.obj, b.obj"),
        ({"a.png": b"x"}, "There must be a file that ends in one of .*, got a.png"),
        ({"a.json": b"x", "b.json": b"x"}, "Open one .json file at a time"),
        ({"": b"x"}, "There must be a file"),
    ],
)
def test_what_cannot_be_opened(tmp_path: Path, content: dict[str, bytes], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        receive(named(content), tmp_path, 1000)
    assert everything_in(tmp_path) == []


def test_a_file_that_comes_twice(tmp_path: Path) -> None:
    twice = [UploadedFile("a.png", io.BytesIO(b"x")), UploadedFile("a.png", io.BytesIO(b"y"))]
    with pytest.raises(ValueError, match="each file once"):
        receive(twice, tmp_path, 1000)


@pytest.mark.parametrize("name", [".", "./", "a/"])
def test_an_entry_of_a_zip_without_a_name_is_left_out(tmp_path: Path, name: str) -> None:
    archive = zipped({name: b"", "tri.obj": OBJ})
    assert receive(named({"tri.zip": archive}), tmp_path, 10_000).mesh is not None


@pytest.mark.parametrize("names", [("a", "a/b.obj"), ("a/b.obj", "a"), ("a.obj", "./a.obj")])
def test_names_that_clash_are_refused_without_the_folder_s_path(tmp_path: Path, names: tuple[str, str]) -> None:
    with pytest.raises(ValueError, match="must have each file once") as refused:
        receive(named({"tri.zip": zipped(dict.fromkeys(names, OBJ))}), tmp_path / "session", 10_000)
    assert str(tmp_path) not in str(refused.value)
    assert everything_in(tmp_path) == []
