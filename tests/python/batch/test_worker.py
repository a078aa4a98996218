"""One job: distillation with an encoder that is loaded once, shapes from elsewhere, and folders that are full."""

from __future__ import annotations

import errno
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import fsspec
import numpy as np
import pytest
from made_field import field_of
from threadpoolctl import threadpool_limits

import dfd
from dfd.batch import steps
from dfd.batch.folder import BatchFolder
from dfd.batch.page import gather, write_page
from dfd.batch.prepare import describe_edits, find_files, place_edits
from dfd.batch.record import Job, Limits, Stopped, new_token
from dfd.batch.settings import BatchSettings
from dfd.batch.worker import work

SMALL = {"views": 4, "resolution": 32, "steps": 10, "batch": 64, "up": "file"}


@pytest.fixture(autouse=True, scope="module")
def _threads(one_thread) -> Iterator[None]:
    """A worker sets the number of threads of its whole process: here it is set back."""
    before = dfd.get_num_threads()
    with threadpool_limits():
        yield
    dfd.set_num_threads(before)


@pytest.fixture(scope="module")
def chair(tmp_path_factory, chair_mesh):
    path = tmp_path_factory.mktemp("chair") / "chair.ply"
    chair_mesh.save(path)
    return path


def job(root, path, name="chair", **how) -> Job:
    limits = Limits(threads=1)
    values = {"root": str(root), "name": name, "path": str(path), "field": None, "attempt": 1, "token": new_token()}
    return Job(**(values | how), limits=limits)


def test_the_encoder_is_loaded_once_and_makes_the_field_that_distill_makes(chair, tiny_encoder, tmp_path):
    settings = BatchSettings(steps=("distill", "pictures"), encoder=str(tiny_encoder), distill=SMALL)
    folder = BatchFolder.begin(tmp_path / "out", settings)
    steps.loaded_encoder.cache_clear()
    for name in ("one", "two"):
        record = work(job(folder.root, chair, name))
        assert (record.status, record.message) == ("done", None)
    assert (steps.loaded_encoder.cache_info().misses, steps.loaded_encoder.cache_info().hits) == (1, 1)
    made = dfd.Field.load(folder.shape("two") / "field.safetensors")
    alone = dfd.distill(chair, tiny_encoder, progress=False, cache=False, device="cpu", **SMALL)
    points = dfd.load(chair).vertices[:50]
    np.testing.assert_allclose(made(points), alone(points), atol=1e-4)
    assert record.files == ["features.png", "field.safetensors", "thumbnail.png"]
    assert record.timings.keys() == {"read", "distill", "pictures"}


def test_a_shape_from_elsewhere_is_brought_here_and_taken_away_again(chair, tmp_path):
    files = fsspec.filesystem("memory")
    files.pipe("/shelf/chair.ply", chair.read_bytes())
    folder = BatchFolder.begin(tmp_path / "out", BatchSettings(steps=("inspect",)))
    try:
        near, far = work(job(folder.root, chair, "near")), work(job(folder.root, "memory:///shelf/chair.ply", "far"))
        missing = work(job(folder.root, "memory:///shelf/none.ply", "missing"))
    finally:
        files.rm("/shelf", recursive=True)
    assert near.sha256 == far.sha256
    assert far.files == ["inspect.json"]
    assert (missing.status, missing.cause) == ("failed", "input")


def test_steps_that_lack_a_field_say_so(chair, tmp_path):
    folder = BatchFolder.begin(tmp_path / "out", BatchSettings(steps=("inspect", "symmetry")))
    record = work(job(folder.root, chair))
    assert (record.status, record.cause, record.files) == ("failed", "input", [])
    assert record.message.startswith("no field: the step distill makes one")


@pytest.mark.parametrize(
    ("error", "cause", "message"),
    [
        (MemoryError("too much"), "memory", "too much"),
        (ValueError("no\nmesh"), "input", "no mesh"),
        (KeyError("where"), "error", "KeyError: 'where' (test_worker.py, line "),
    ],
)
def test_whatever_a_step_raises_is_the_shapes_own(chair, tmp_path, monkeypatch, error, cause, message):
    def fail(task: steps.Work) -> None:
        task.write_json("half.json", {})
        raise error

    monkeypatch.setattr(steps.Work, "inspect", fail)
    folder = BatchFolder.begin(tmp_path / "out", BatchSettings(steps=("inspect",)))
    record = work(job(folder.root, chair))
    assert (record.status, record.cause) == ("failed", cause)
    assert record.message.startswith(message)
    assert [path.name for path in folder.shape("chair").iterdir()] == ["record.json"]


def test_a_full_disk_stops_the_batch_and_is_no_failure_of_the_shape(chair, tmp_path, monkeypatch):
    def full(task: steps.Work) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(steps.Work, "inspect", full)
    folder = BatchFolder.begin(tmp_path / "out", BatchSettings(steps=("inspect",)))
    found = work(job(folder.root, chair))
    assert isinstance(found, Stopped)
    assert found.why.endswith("cannot be used: No space left on device")
    assert folder.record("chair") is None


def test_edits_come_into_the_folder_with_what_they_were_made_on(chair, tmp_path):
    mesh = dfd.load(chair)
    field = field_of(mesh)
    field.save(chair.with_name("chair.field.safetensors"))
    session = dfd.Deformer(mesh, field)
    session.add(40, translation=(0, 0.1, 0))
    session.save(tmp_path / "leg.json")
    files = [find_files(tmp_path / "leg.json", chair)]
    (source,) = describe_edits(files)
    settings = BatchSettings(steps=("edits",), edits=(source,))
    folder = BatchFolder.begin(tmp_path / "out", settings)
    for _ in range(2):
        place_edits(folder, files, settings.edits)
    names = sorted(path.name for path in folder.edits.iterdir())
    assert names == ["leg.edit.json", "leg.field.safetensors", "leg.original.ply"]
    record = work(job(folder.root, chair, field=str(chair.with_name("chair.field.safetensors"))))
    assert record.figures["leg_confidence"] == 1.0
    assert record.files == ["leg.edit.json"]
    with pytest.raises(ValueError, match="`--edit` must have distinct names, got leg twice"):
        describe_edits(files * 2)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ValueError, match=r"other.json: "):
        find_files(tmp_path / "other.json", chair)
    chair.with_name("lonely.ply").write_bytes(chair.read_bytes())
    with pytest.raises(
        FileNotFoundError, match=r"lonely.field.safetensors, the field of .*, does not exist: `dfd distill`"
    ):
        find_files(tmp_path / "leg.json", chair.with_name("lonely.ply"))
    with pytest.raises(
        ValueError, match=r"`--made-on` must name the mesh that .*leg.json was made on: it does not say"
    ):
        find_files(tmp_path / "leg.json")


def test_an_edit_says_where_its_mesh_and_its_field_are(chair, tmp_path):
    chair = Path(shutil.copy(chair, tmp_path / "chair.ply"))  # of its own: other tests put a field beside that one
    mesh = dfd.load(chair)
    field = field_of(mesh)
    (tmp_path / "fields").mkdir()
    kept = tmp_path / "fields" / "any.field.safetensors"
    field.save(kept)
    session = dfd.Deformer(mesh, dfd.Field.load(kept))
    session.add(40, translation=(0, 0.1, 0))
    (tmp_path / "edits").mkdir()
    session.save(tmp_path / "edits" / "leg.json")
    assert find_files(tmp_path / "edits" / "leg.json") == (tmp_path / "edits" / "leg.json", chair.resolve(), kept)
    session.save(tmp_path / "leg.json")
    assert '"field": "fields/any.field.safetensors"' in (tmp_path / "leg.json").read_text()
    (source,) = describe_edits([find_files(tmp_path / "leg.json")])
    assert source.mesh == "leg.original.ply"

    kept.write_bytes(b"another")
    with pytest.raises(FileNotFoundError, match=r"does not exist, and .*any.field.safetensors is another one"):
        find_files(tmp_path / "leg.json")
    field.save(chair.with_name("chair.field.safetensors"))
    assert find_files(tmp_path / "leg.json").field == chair.resolve().with_name("chair.field.safetensors")
    chair.rename(chair.with_name("moved.ply"))
    with pytest.raises(FileNotFoundError, match=r"on which .*leg.json was made, does not exist: `--made-on` must say"):
        find_files(tmp_path / "leg.json")


def test_an_edit_that_does_not_fit_is_told_and_is_no_failure(chair, tmp_path):
    mesh = dfd.load(chair)
    field = field_of(mesh)
    field.save(chair.with_name("chair.field.safetensors"))
    session = dfd.Deformer(mesh, field)
    session.add(40, translation=(0, 0.1, 0))
    session.save(tmp_path / "leg.json")
    files = [find_files(tmp_path / "leg.json", chair)]
    settings = BatchSettings(
        steps=("edits", "exports"),
        edits=describe_edits(files),
        exports=("obj", "rig.glb", "weights.npz"),
        threshold=1.0,
    )
    folder = BatchFolder.begin(tmp_path / "out", settings)
    place_edits(folder, files, settings.edits)
    squeezed = dfd.Mesh(mesh.vertices * (1, 0.3, 1), mesh.faces)
    squeezed.save(tmp_path / "squeezed.ply")
    field_of(squeezed, seed=5).save(tmp_path / "squeezed.field.safetensors")
    found = work(job(folder.root, tmp_path / "squeezed.ply", field=str(tmp_path / "squeezed.field.safetensors")))
    assert (found.status, found.files) == ("done", [])
    assert found.figures["leg_refused"].startswith("nothing looks enough like what handle 1 held")
    fits = work(job(folder.root, chair, "itself", field=str(chair.with_name("chair.field.safetensors"))))
    assert fits.files == ["leg.edit.json", "leg.obj", "leg.rig.glb", "leg.weights.npz"]


def test_a_machine_that_does_not_see_the_folder_stops_the_batch(chair, tmp_path):
    found = work(job(tmp_path / "elsewhere", chair))
    assert isinstance(found, Stopped)
    assert found.why.endswith("the machine of a worker must see the same folder as that of the driver")


def test_an_export_that_fails_is_named_and_all_else_stays(chair, tmp_path, monkeypatch):
    mesh = dfd.load(chair)
    beside = chair.with_name("chair.field.safetensors")
    field_of(mesh).save(beside)
    session = dfd.Deformer(mesh, dfd.Field.load(beside))
    session.add(40, translation=(0, 0.1, 0))
    session.save(tmp_path / "leg.json")
    files = [find_files(tmp_path / "leg.json", chair)]
    settings = BatchSettings(
        steps=("parts", "pictures", "edits", "exports"), edits=describe_edits(files), exports=("rig.glb", "obj")
    )
    folder = BatchFolder.begin(tmp_path / "out", settings)
    place_edits(folder, files, settings.edits)

    def refuse(path: Path, deformer: dfd.Deformer) -> None:
        raise ValueError("no room\nfor it")

    monkeypatch.setitem(steps.WRITERS, "rig.glb", refuse)
    record = work(job(folder.root, chair, field=str(beside)))
    pictures = ["features.png", "leg.png", "parts.json", "parts.png", "thumbnail.png"]
    assert (record.status, record.files) == ("done", sorted(["leg.edit.json", "leg.obj", *pictures]))
    assert (record.figures["leg.rig.glb_failed"], record.figures["leg.obj_failed"]) == (
        "leg.rig.glb: no room for it",
        None,
    )
    cut = json.loads((folder.shape("chair") / "parts.json").read_text())
    assert len(cut["parts"]) == record.figures["parts"] >= 1
    assert set(cut["part_of_vertex"]) <= set(range(1, len(cut["parts"]) + 1))
    broken = job(folder.root, "missing.ply", "broken").record(settings.hash(), seconds=0.0, cause="input")
    page = write_page(folder, settings, gather([broken, record], settings)).read_text()
    assert "<h1>2 shapes: 1 done, 1 failed: bad input; 1 without an export</h1>" in page
    assert "<small>leg.rig.glb: no room for it</small>" in page
