"""A batch's folder: what is finished appears whole, and once."""

from __future__ import annotations

import os

import pytest

from dfd.batch.folder import BatchFolder, read_settings
from dfd.batch.record import Record
from dfd.batch.settings import BatchSettings

SETTINGS = BatchSettings(steps=("inspect",))


def record(name: str, **how: object) -> Record:
    return Record(name=name, path=f"{name}.obj", status="done", settings=SETTINGS.hash(), attempts=1, seconds=1, **how)


@pytest.fixture
def folder(tmp_path):
    return BatchFolder.begin(tmp_path / "out", SETTINGS)


def test_a_shape_appears_with_its_record_and_nothing_else_of_the_attempt(folder):
    place = folder.begin_attempt("chair", "1")
    (place / "inspect.json").write_text("{}")
    assert folder.record("chair") is None
    folder.publish(place, record("chair"))
    assert folder.record("chair") == record("chair")
    assert sorted(path.name for path in folder.shape("chair").iterdir()) == ["inspect.json", "record.json"]
    assert list(folder.work.iterdir()) == []


def test_of_two_attempts_the_second_finds_the_place_taken(folder):
    first, second = (folder.begin_attempt("chair", token) for token in "12")
    assert folder.publish(first, record("chair", size=1)).size == 1
    assert folder.publish(second, record("chair", size=2)).size == 1
    assert folder.record("chair").size == 1
    assert list(folder.work.iterdir()) == []


def test_what_dead_processes_left_is_swept_and_what_works_is_not(folder):
    mine, dead = folder.begin_attempt("chair", "1"), folder.begin_attempt("table", "2")
    host = (dead / "owner").read_text().split()[1]
    (dead / "owner").write_text(f"999999999 {host}")
    elsewhere = folder.begin_attempt("bench", "3")
    (elsewhere / "owner").write_text("999999999 another-machine")
    folder.sweep()
    assert mine.exists()
    assert elsewhere.exists()
    assert not dead.exists()


def test_a_shape_that_is_retired_is_gone(folder):
    folder.publish(folder.begin_attempt("chair", "1"), record("chair"))
    folder.retire("chair")
    folder.retire("chair")
    assert folder.record("chair") is None
    assert not folder.shape("chair").exists()


def test_many_shapes_lie_in_folders_of_folders(tmp_path):
    settings = BatchSettings(steps=("inspect",), sharded=True)
    folder = BatchFolder.begin(tmp_path / "out", settings)
    folder.publish(folder.begin_attempt("chair", "1"), record("chair"))
    assert folder.shape("chair").parent.parent.name == "shapes"
    assert folder.record("chair") is not None


def test_a_damaged_record_is_none(folder):
    folder.publish(folder.begin_attempt("chair", "1"), record("chair"))
    (folder.shape("chair") / "record.json").write_text('{"name": "chair"')
    assert folder.record("chair") is None


def test_another_run_in_the_same_folder_is_refused(folder):
    with folder.lock(0, 1), pytest.raises(ValueError, match="another run is at work in"), folder.lock(0, 1):
        pass
    with folder.lock(0, 2), folder.lock(1, 2):
        pass


def test_the_same_settings_go_on_and_others_are_refused(folder):
    assert BatchFolder.begin(folder.root, SETTINGS).root == folder.root
    assert read_settings(folder.root) == SETTINGS
    other = BatchSettings(steps=("pictures",), encoder="dinov2-base")
    with pytest.raises(ValueError, match=r"was begun with other settings \(steps .*, encoder dinov2-small-focus, now"):
        BatchFolder.begin(folder.root, other)


def test_a_folder_that_cannot_be_is_refused(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()
    with pytest.raises(NotADirectoryError, match="must be a folder, but"):
        BatchFolder.begin(tmp_path / "file", SETTINGS)
    with pytest.raises(FileNotFoundError, match="the folder .*none does not exist"):
        BatchFolder.begin(tmp_path / "none" / "out", SETTINGS)
    with pytest.raises(ValueError, match="must be a new folder or one of an earlier batch"):
        BatchFolder.begin(tmp_path / "full", SETTINGS)
    (tmp_path / "full" / "batch.json").write_text('{"format": "dfd-batch", "version": 2, "steps": ["inspect"]}')
    with pytest.raises(ValueError, match=r"batch.json cannot be gone on from: version: .*"):
        BatchFolder.begin(tmp_path / "full", SETTINGS)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OSError, match="cannot be written"):
        BatchFolder.begin(tmp_path / "out", SETTINGS)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"steps": ()}, "`--step` must name at least one of inspect"),
        ({"steps": ("inspect", "dance")}, "`--step` must be of inspect, .*, got dance"),
        ({"steps": ("inspect", "edits")}, "`--edit` and the step edits must be given together"),
        ({"steps": ("inspect",), "exports": ("glb",)}, "`--export` and the step exports must be given together"),
        ({"steps": ("exports",), "exports": ("glb",)}, "`--step` must hold edits for exports"),
        ({"steps": ("exports",), "exports": ("doc",)}, "`--export` must be of glb, .*, got doc"),
    ],
)
def test_settings_check_themselves(values, message):
    with pytest.raises(ValueError, match=message):
        BatchSettings(**values)


def test_steps_stand_in_the_order_in_which_they_work():
    assert BatchSettings(steps=("pictures", "inspect", "inspect")).steps == ("inspect", "pictures")
    assert BatchSettings(steps=("pictures", "inspect")).hash() == BatchSettings(steps=("inspect", "pictures")).hash()
