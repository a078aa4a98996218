"""Test the edits that are kept in the data folder: which session gets which, and what stays on disk."""

import os
from pathlib import Path

import pytest
from mesh_files import CORNERS, CUBE

import dfd
from dfd.app.session import kept_edits
from dfd.app.session.kept_edits import KeptEdit, find_recent, recent_edits
from dfd.editing.edit import Edit, Handle
from dfd.editing.edit_file import MadeOn, read_edit
from dfd.editing.points import place_on

CORNER = dfd.Mesh(CORNERS, CUBE)
MOVED = dfd.Mesh(CORNERS + 0.001, CUBE)
EMPTY = Edit()
HASH = CORNER.content_hash


def edit_at(vertex, mesh=CORNER):
    return Edit(handles=(Handle(1, place_on(mesh, vertex)),))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("DFD_DATA", str(tmp_path / "data"))
    monkeypatch.setattr(kept_edits, "LEAVES", 0.02)
    return tmp_path / "data" / "edits"


@pytest.fixture
def keep():
    """Return a function that opens a kept edit. All are released at the end."""
    opened = []

    def keep(mesh=CORNER, made_on=None, **options):
        opened.append(KeptEdit(mesh, made_on or MadeOn(), **options))
        return opened[-1]

    yield keep
    for each in opened:
        each.release()


def stored(keep, vertex, **options):
    """Store an edit with one handle, and unlock it."""
    kept = keep(**options)
    assert kept.save(edit_at(vertex))
    kept.release()
    return kept


def test_only_a_change_is_stored_and_the_next_session_continues_it(keep, folder):
    kept = keep()
    assert kept.read() is None
    assert not kept.is_copy
    kept.begin(EMPTY)
    assert not kept.changed(EMPTY)
    assert not kept.save(EMPTY)
    assert not kept.path.exists()
    edit = edit_at(5)
    assert kept.changed(edit)
    assert kept.save(edit)
    assert not kept.changed(edit)
    assert not kept.save(edit)
    assert kept.path == folder / f"{HASH}.json"
    kept.release()
    assert not kept.save(edit_at(4)), "it belongs to other sessions now"
    again = keep()
    assert again.read() == edit
    assert not again.is_copy


def test_sessions_on_one_mesh_get_copies_of_its_edit(keep):
    first = keep()
    first.save(edit_at(5))
    second, third = keep(), keep()
    assert [each.key for each in (first, second, third)] == [HASH, f"{HASH}-2", f"{HASH}-3"]
    assert [each.is_copy for each in (first, second, third)] == [False, True, True]
    assert second.read() == third.read() == edit_at(5)
    second.save(edit_at(4))
    second.release()
    assert keep(key=f"{HASH}-2").read() == edit_at(4)
    assert first.read() == edit_at(5)


def test_a_changed_mesh_continues_the_edit_that_is_asked_for_unless_it_has_its_own(keep):
    stored(keep, 5)
    moved = keep(MOVED, key=HASH)
    assert moved.key == MOVED.content_hash
    with pytest.warns(UserWarning, match="found by position"):
        assert [each.place.vertex for each in moved.read().handles] == [None]
    moved.save(edit_at(4, MOVED))
    moved.release()
    assert keep(MOVED, key=HASH).read() == edit_at(4, MOVED)


def test_a_change_is_overdue_after_two_seconds(keep, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(kept_edits.time, "monotonic", lambda: now[0])
    kept = keep()
    kept.begin(EMPTY)
    assert not kept.overdue
    for now[0], overdue in ((100.0, False), (101.0, False), (102.1, True)):
        assert kept.changed(edit_at(5))
        assert kept.overdue == overdue
    assert kept.save(edit_at(5))
    assert not kept.overdue


def test_a_damaged_edit_is_put_aside(keep, folder):
    path = stored(keep, 5).path
    path.write_text("{")
    kept = keep()
    with pytest.raises(ValueError, match=rf"cannot be read, and is now in the file {path.name}.damaged: no whole JSON"):
        kept.read()
    assert kept.save(edit_at(4))
    assert (folder / f"{path.name}.damaged").read_text() == "{"
    assert read_edit(path, CORNER) == edit_at(4)


def test_an_edit_that_another_replaces_can_be_set_aside(keep, folder):
    kept = keep()
    kept.set_aside()
    assert not list(folder.glob("*.json"))
    kept.save(edit_at(5))
    kept.set_aside()
    kept.save(edit_at(4))
    assert read_edit(folder / f"{HASH}-2.json", CORNER) == edit_at(5)
    assert read_edit(folder / f"{HASH}.json", CORNER) == edit_at(4)


def test_a_session_that_comes_back_gets_what_others_did_meanwhile(keep):
    first = keep()
    first.save(edit_at(5))
    assert first.resume() is None, "it was not released"
    first.release()
    assert first.resume() is None, "nothing has changed"
    first.release()
    second = keep()
    assert second.read() == edit_at(5)
    second.save(edit_at(4))
    second.release()
    assert first.resume() == edit_at(4)
    assert not first.is_copy
    first.release()
    second.resume()
    assert first.resume() is None
    assert first.is_copy, "the other session has it open"
    assert first.key == f"{HASH}-2"
    assert first.save(edit_at(4)), "the copy has no file yet"


def upload(tmp_path, name):
    """Write the files of an upload, a mesh with a texture, and return the mesh file."""
    made = tmp_path / "uploads" / name / "shape" / "mesh.obj"
    made.parent.mkdir(parents=True)
    made.write_text("v 0 0 0")
    (made.parent / "texture.png").write_bytes(b"1234567890")
    return made


def test_files_of_uploads_stay_beside_the_edit_and_others_where_they_are(keep, folder, tmp_path):
    mesh, field = upload(tmp_path, "one"), tmp_path / "own.safetensors"
    field.write_bytes(b"")
    made_on = MadeOn(str(mesh), str(field), name="mine.obj")
    stored(keep, 5, made_on=made_on, uploads=tmp_path / "uploads")
    (found,) = recent_edits(5)
    assert (found.key, found.name, found.handles, found.field) == (HASH, "mine.obj", 1, field)
    assert found.mesh == folder / HASH / "one" / "shape" / "mesh.obj"
    mesh.unlink()
    assert found.mesh.read_text() == "v 0 0 0"
    assert (found.mesh.parent / "texture.png").exists()
    field.unlink()
    assert find_recent(HASH).field is None
    found.mesh.unlink()
    assert find_recent(HASH).mesh is None


@pytest.mark.parametrize(("limit", "kept"), [(17, "1"), (34, "12"), (100, "012"), (5, "1")])
def test_files_of_the_oldest_edits_are_removed_beyond_the_limit(keep, folder, tmp_path, monkeypatch, limit, kept):
    """Each upload has 17 bytes. The upload that was stored last stays, even if it alone exceeds the limit."""
    meshes = [dfd.Mesh(CORNERS + number, CUBE) for number in range(3)]
    for number, age in ((0, 30), (2, 10), (1, 0)):
        monkeypatch.setattr(kept_edits, "LIMIT", limit if number == 1 else 100)
        made_on = MadeOn(str(upload(tmp_path, f"{number}")))
        one = keep(meshes[number], made_on, uploads=tmp_path / "uploads")
        one.save(edit_at(5, meshes[number]))
        seconds = one.path.stat().st_mtime - age
        os.utime(one.path, (seconds, seconds))
    there = [str(number) for number, mesh in enumerate(meshes) if list((folder / mesh.content_hash).glob("*"))]
    assert there == list(kept)
    assert len(recent_edits(5)) == 3, "the edits themselves stay"


def test_recent_edits_are_those_changed_last_and_damaged_ones_are_left_out(keep, folder):
    meshes = [dfd.Mesh(CORNERS + number, CUBE) for number in range(3)]
    for mesh, age in zip(meshes, (20, 30, 10), strict=True):
        kept = keep(mesh)
        kept.save(edit_at(5, mesh))
        os.utime(kept.path, (1e9 - age, 1e9 - age))
    (folder / "damaged.json").write_text("{}")
    wanted = [meshes[number].content_hash for number in (2, 0, 1)]
    assert [each.key for each in recent_edits(5)] == wanted
    assert [each.key for each in recent_edits(2)] == wanted[:2]
    assert find_recent(wanted[0]) == recent_edits(1)[0]
    assert find_recent(wanted[0]).seconds == 1e9 - 10
    assert find_recent(wanted[0]).name == "mesh"
    Path(folder.parent / "other.json").write_text((folder / f"{HASH}.json").read_text())
    for key in ("0" * 64, "../other", ""):
        with pytest.raises(ValueError, match="This edit is no longer kept"):
            find_recent(key)


def test_what_cannot_be_written_is_said_once_for_each_change(keep, folder):
    kept = keep()
    kept.path.mkdir()
    with pytest.raises(OSError, match="Your edit could not be stored: "):
        kept.save(edit := edit_at(5))
    assert not kept.save(edit)
