"""Test whole batches: good and bad shapes, resumption, and the reports of Ray about processes that ended."""

import json
import os
import re
import sys
from collections import Counter
from urllib.parse import unquote

import numpy as np
import pytest
from fake_ray import FakeRay, OutOfMemoryError, RayError
from made_field import field_of

import dfd
from dfd.batch import steps
from dfd.batch.inputs import find_shapes
from dfd.batch.one_edit import find_files
from dfd.batch.record import read_record
from dfd.batch.run import Resources, run_batch
from dfd.batch.settings import BatchSettings, begin_folder
from dfd.distillation.settings import DistillSettings
from dfd.editing.edit_file import read_edit

GOOD = ("chair", "large", "wide")


@pytest.fixture(scope="module")
def shapes(tmp_path_factory, chair_mesh):
    """Return a folder with three good shapes and their fields, five bad shapes, a manifest and an edit."""
    folder = tmp_path_factory.mktemp("shapes")
    rows = ["name,path,field"]
    for name, factor in zip(GOOD, (1.0, 3.0, (1.2, 1.0, 1.0)), strict=True):
        mesh = dfd.Mesh(chair_mesh.vertices * factor, chair_mesh.faces)
        mesh.save(folder / f"{name}.ply")
        field_of(dfd.load(folder / f"{name}.ply")).save(folder / f"{name}.field.safetensors")
        rows.append(f"{name},{name}.ply,{name}.field.safetensors")
    (folder / "bad-empty.ply").touch()
    (folder / "bad-cut.glb").write_bytes(b"glTF\2\0\0\0")
    (folder / "bad-nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    rows += [f"{path.stem},{path.name}," for path in sorted(folder.glob("bad-*"))]
    rows += ["bad-missing,none.obj,", "bad-field,chair.ply,none.field.safetensors"]
    (folder / "list.csv").write_text("\n".join(rows))
    session = dfd.Deformer(folder / "chair.ply", field_of(dfd.load(folder / "chair.ply")))
    session.add(40, translation=(0, -0.2, 0), name="leg")
    session.save(folder / "leg.json")
    return folder


def all_steps(shapes):
    edit = find_files(shapes / "leg.json", shapes / "chair.ply")
    steps = ("inspect", "features", "symmetry", "pictures", "edits", "exports")
    return BatchSettings(steps=steps, edits=(edit,), exports=("ply", "rig.glb"))


@pytest.fixture(scope="module")
def finished(shapes, tmp_path_factory):
    """Return the folder and the records of a finished batch of all shapes."""
    root, patch = tmp_path_factory.mktemp("finished") / "out", pytest.MonkeyPatch()
    with patch.context() as patched:
        patched.setitem(sys.modules, "ray", FakeRay())
        begin_folder(root, all_steps(shapes))
        records = run_batch(find_shapes([str(shapes / "list.csv")]), all_steps(shapes), root, Resources())
    return root, {record.name: record for record in records}


def test_a_failed_shape_has_its_cause_and_stops_no_other(finished):
    root, records = finished
    assert {name for name, record in records.items() if record.status == "done"} == set(GOOD)
    assert {record.cause for name, record in records.items() if name not in GOOD} == {"input"}
    assert "none.obj" in records["bad-missing"].message
    assert [path.name for path in (root / "shapes" / "bad-field").iterdir()] == ["record.json"]
    lines = [json.loads(line) for line in (root / "shapes.jsonl").read_text().splitlines()]
    assert {line["name"]: line["status"] for line in lines} == {name: each.status for name, each in records.items()}


def test_a_shape_has_what_each_step_makes(finished, shapes):
    root, records = finished
    made, record = root / "shapes" / "large", records["large"]
    data = ["features.npz", "features.png", "inspect.json", "symmetry.json", "thumbnail.png"]
    assert record.files == sorted([*data, "leg.edit.json", "leg.ply", "leg.png", "leg.rig.glb"])
    assert sorted(path.name for path in made.iterdir()) == sorted([*record.files, "record.json"])
    mesh = dfd.load(shapes / "large.ply")
    with np.load(made / "features.npz") as small:
        rows = small["rows"].astype(np.float32) @ small["basis"].T + small["mean"]
    assert np.abs(rows - field_of(mesh)(mesh.vertices)).max() < 0.1
    assert np.abs(dfd.load(made / "leg.ply").vertices - mesh.vertices).max() > 0.3
    assert record.figures["leg_confidence"] == pytest.approx(0.9283, abs=1e-2)
    assert record.timings["inspect"] > 0


def test_the_page_shows_every_shape_and_all_that_it_links_to_is_there(finished):
    root, _ = finished
    page = (root / "index.html").read_text()
    assert page.count("<article") == 8
    assert page.index("bad-cut") < page.index("thumbnail.png")
    assert all((root / unquote(link)).exists() for link in re.findall(r"(?:href|src)='([^']+)'", page))
    assert "://" not in page


def run(inputs, root, monkeypatch, ends=None, timeout=None, **how):
    """Run a batch, and return the causes of the records and the shapes that were started."""
    ray = FakeRay(**(ends or {}))
    monkeypatch.setitem(sys.modules, "ray", ray)
    settings = BatchSettings(steps=("inspect",))
    begin_folder(root, settings)
    records = run_batch(find_shapes([inputs]), settings, root, Resources(timeout=timeout), **how)
    assert ray.options.get("shut", False) == bool(ray.started)
    return {record.name: record.cause for record in records}, ray.started


def test_the_preset_is_that_of_the_planes_and_of_the_edits(shapes, tmp_path, monkeypatch):
    def planes(field, mesh, **how):
        asked.append(how)
        return []

    asked = []
    monkeypatch.setattr(steps, "symmetry_planes", planes)
    monkeypatch.setitem(sys.modules, "ray", FakeRay())
    settings = all_steps(shapes).model_copy(update={"steps": ("symmetry", "edits"), "exports": (), "preset": "paper"})
    chair = next(shape for shape in find_shapes([str(shapes / "list.csv")]) if shape.name == "chair")
    (record,) = run_batch([chair], settings, tmp_path, Resources())
    assert record.cause is None
    assert asked == [{"candidates": "axes", "threshold": 0.1}]
    (edit,) = tmp_path.rglob("leg.edit.json")
    assert read_edit(edit, dfd.load(shapes / "chair.ply")).preset == "paper"


def test_the_step_distill_uses_the_fields_that_other_commands_cached(chair_mesh, tiny_encoder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", FakeRay())
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    chosen = DistillSettings(views=4, resolution=32, steps=2, batch=16, up="file").as_dict()
    settings = BatchSettings(steps=("distill",), encoder=str(tiny_encoder), distill=chosen)
    for name, factor in (("known", 1.0), ("new", (1.2, 1.0, 1.0))):
        dfd.Mesh(chair_mesh.vertices * factor, chair_mesh.faces).save(tmp_path / f"{name}.ply")
    known, new = (dfd.load(tmp_path / f"{name}.ply") for name in ("known", "new"))
    how = {"device": "cpu", "progress": False}
    before = dfd.distill(known, tiny_encoder, **how, **chosen)
    records = run_batch(find_shapes([f"{tmp_path}/*.ply"]), settings, tmp_path / "out", Resources())
    assert [record.cause for record in records] == [None, None]
    made = dfd.Field.load(next((tmp_path / "out").rglob("known*/field.safetensors")))
    assert made.settings["losses"] == before.settings["losses"]
    monkeypatch.setattr("dfd.distillation.distill._prepare", None)  # a new distillation would fail
    assert dfd.distill(new, tiny_encoder, **how, **chosen).settings["views"] == 4


def test_a_run_does_what_is_missing_changed_or_to_be_repeated(chair_mesh, tmp_path, monkeypatch):
    for name in ("a", "b"):
        chair_mesh.save(tmp_path / f"{name}.ply")
    (tmp_path / "c.ply").write_text("no mesh")
    root, inputs = tmp_path / "out", f"{tmp_path}/*.ply"
    causes, started = run(inputs, root, monkeypatch)
    assert causes == {"a.ply": None, "b.ply": None, "c.ply": "input"}
    assert started == ["a.ply", "b.ply", "c.ply"]
    assert run(inputs, root, monkeypatch) == (causes, [])
    os.utime(tmp_path / "b.ply", ns=(1, 1))
    assert run(inputs, root, monkeypatch)[1] == ["b.ply"]
    (root / "shapes" / "a.ply" / "record.json").unlink()  # an interrupted run leaves no record
    assert run(inputs, root, monkeypatch, retry=True)[1] == ["a.ply", "c.ply"]


def test_ended_processes_are_recorded_by_their_causes(chair_mesh, tmp_path, monkeypatch):
    for name in ("crash", "fine", "hangs", "large"):
        chair_mesh.save(tmp_path / f"{name}.ply")
    ends = {"crash.ply": RayError("the worker died"), "hangs.ply": "hangs", "large.ply": OutOfMemoryError("killed")}
    causes, _ = run(f"{tmp_path}/*.ply", tmp_path / "out", monkeypatch, ends, timeout=0.2)
    assert causes == {"crash.ply": "crash", "fine.ply": None, "hangs.ply": "timeout", "large.ply": "memory"}
    shape = find_shapes([str(tmp_path / "hangs.ply")])[0]
    assert read_record(tmp_path / "out", shape).message == "took longer than 0.2 s"


def test_a_folder_that_cannot_be_written_ends_the_batch(chair_mesh, tmp_path, monkeypatch):
    chair_mesh.save(tmp_path / "a.ply")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dfd.batch.steps.write_record", full)
    with pytest.raises(OSError, match=r"`--output`: .* cannot be written: .*No space left"):
        run(f"{tmp_path}/*.ply", tmp_path / "out", monkeypatch)


def test_odd_names_stop_no_batch(chair_mesh, tmp_path, monkeypatch):
    folder = tmp_path / "shapes"
    folder.mkdir()
    chair_mesh.save(folder / "a.ply")
    content = (folder / "a.ply").read_bytes()
    for name in (os.fsdecode(b"\xff.ply"), os.fsdecode(b"\xfe.ply"), f"{'n' * 230}.ply", "\x1b[2J.ply", "A.ply"):
        (folder / name).write_bytes(content)
    causes, _ = run(f"{folder}/*.ply", tmp_path / "out", monkeypatch)
    assert Counter(causes.values()) == {None: 6}
    lines = (tmp_path / "out" / "shapes.jsonl").read_text().splitlines()
    assert {json.loads(line)["path"] for line in lines} == {str(path) for path in folder.iterdir()}


@pytest.mark.slow
@pytest.mark.processes
def test_two_shapes_on_a_local_ray(shapes, tmp_path):
    pytest.importorskip("ray")
    settings = BatchSettings(steps=("inspect", "pictures"))
    begin_folder(tmp_path / "out", settings)
    found = find_shapes([str(shapes / "chair.ply"), str(shapes / "bad-cut.glb")])
    records = run_batch(found, settings, tmp_path / "out", Resources(workers=1, timeout=300))
    assert [(record.name, record.cause) for record in records] == [("bad-cut.glb", "input"), ("chair.ply", None)]
    assert (tmp_path / "out" / "shapes" / "chair.ply" / "thumbnail.png").is_file()
