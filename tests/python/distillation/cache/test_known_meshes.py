"""Which mesh a file holds is noted: only of a file by itself, and never for longer than its bytes stay."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import dfd
from dfd import Mesh
from dfd.field import cache as field_cache
from dfd.field.cache import MESH_VERSION, hash_file, note, recall

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n"


@pytest.fixture(autouse=True)
def notes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The file of notes, the test's own."""
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "meshes.json"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "shape.obj"
    path.write_text(TETRAHEDRON)
    return path


def test_what_was_noted_is_recalled(file: Path) -> None:
    mesh = dfd.load(file)
    assert recall(hash_file(file)) is None
    note(hash_file(file), mesh)
    known = recall(hash_file(file))
    assert known is not None
    assert known.content_hash == mesh.content_hash
    copy = file.with_name("copy.obj")
    copy.write_text(TETRAHEDRON)
    assert recall(hash_file(copy)) == known
    file.write_text(TETRAHEDRON.replace("v 1 0 0", "v 2 0 0"))
    assert recall(hash_file(file)) is None


def test_the_same_bytes_in_another_format_are_another_mesh(file: Path) -> None:
    off = file.with_suffix(".off")
    off.write_bytes(file.read_bytes())
    assert hash_file(off) != hash_file(file)


def test_another_version_reads_anew(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = hash_file(file)
    with monkeypatch.context() as patch:
        patch.setattr("dfd.field.cache.MESH_VERSION", MESH_VERSION + 1)
        assert hash_file(file) != before
    monkeypatch.setattr("dfd.field.cache.version", lambda package: f"another {package}")
    assert hash_file(file) != before


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("shape.obj", "mtllib shape.mtl\n" + TETRAHEDRON),
        ("shape.obj", TETRAHEDRON + "MTLLIB shape.mtl\n"),
        ("shape.ply", "ply\ncomment TextureFile shape.png\n"),
        ("shape.gltf", '{"buffers": [{"uri": "shape.bin"}]}'),
    ],
)
def test_a_file_that_names_another_is_always_read(tmp_path: Path, name: str, content: str) -> None:
    (tmp_path / name).write_text(content)
    assert hash_file(tmp_path / name) is None


def test_nothing_is_known_of_no_file(file: Path, tmp_path: Path, notes: Path) -> None:
    assert hash_file(tmp_path / "none.obj") is None
    assert hash_file(tmp_path) is None
    assert recall(None) is None
    note(None, dfd.load(file))
    assert not notes.exists()


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"0": 1}', "\udcff"])
def test_damaged_notes_are_none(file: Path, notes: Path, content: str) -> None:
    notes.parent.mkdir()
    notes.write_bytes(content.encode("utf-8", "surrogateescape"))
    assert recall("0") is None
    note("1", dfd.load(file))
    assert recall("1") is not None


def test_the_first_notes_are_forgotten_first(file: Path, notes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field_cache, "MOST_MESHES", 2)
    mesh: Mesh = dfd.load(file)
    for name in ("a", "b", "c"):
        note(name, mesh)
    assert list(json.loads(notes.read_text())) == ["b", "c"]


def test_a_cache_that_cannot_be_written_is_no_matter(file: Path, notes: Path) -> None:
    notes.parent.write_text("a file where a folder should be")
    note(hash_file(file), dfd.load(file))
    assert recall(hash_file(file)) is None
