"""`dfd batch` from end to end: good and bad shapes, a killed worker, a killed driver, ranks, and Ray."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import psutil
import pytest
from heeding import HEED
from made_field import field_of
from pyarrow import parquet

import dfd
from dfd.batch.folder import BatchFolder
from dfd.batch.inputs import Shape, find_shapes
from dfd.batch.pool import ProcessSlots
from dfd.batch.record import Limits, Record
from dfd.batch.run import Summary, run_batch
from dfd.batch.settings import BatchSettings

pytestmark = pytest.mark.processes

GOOD = ("chair", "large", "wide")
WITHOUT_TIMES = ("name", "status", "cause", "sha256", "size", "vertices", "faces", "components", "leg_confidence")


class Quiet:
    """Notes in which order shapes end."""

    def __init__(self) -> None:
        self.ended_names: list[str] = []

    def begun(self, total: int, finished: int) -> None:
        self.total, self.finished = total, finished

    def ended(self, record: Record) -> None:
        self.ended_names.append(record.name)

    def looked(self) -> None:
        pass


@pytest.fixture(scope="module")
def shapes(tmp_path_factory, chair_mesh):
    """Three shapes with fields and a manifest, five bad ones, and an edit."""
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
    rows += ["bad-missing,none.obj,", f"bad-field,chair.ply,{'none.field.safetensors'}"]
    (folder / "list.csv").write_text("\n".join(rows))
    os.mkfifo(folder / "bad-hangs.obj")  # nobody writes to it: reading it waits forever
    session = dfd.Deformer(folder / "chair.ply", field_of(dfd.load(folder / "chair.ply")))
    session.add(40, translation=(0, -0.2, 0), name="leg")
    session.save(folder / "leg.json")
    return folder


def command(shapes: Path, output: Path, *more: object) -> list[str]:
    steps = ("--step", "inspect,features,symmetry,pictures,edits,exports", "--export", "ply", "--timeout", "200")
    edit = ("--edit", shapes / "leg.json", "--made-on", shapes / "chair.ply")
    parts = ("-m", "dfd", "batch", shapes / "list.csv", "-o", output, *steps, *edit, "--workers", "2", *more)
    return [sys.executable, *map(str, parts)]


@pytest.fixture(scope="module")
def finished(shapes, tmp_path_factory):
    """All of it, done by a run of the command."""
    output = tmp_path_factory.mktemp("finished") / "out"
    done = subprocess.run(command(shapes, output), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1, done.stderr
    return output, done.stderr


def table(output: Path) -> list[dict[str, object]]:
    return parquet.read_table(output / "shapes.parquet").to_pylist()


def test_every_shape_has_its_row_and_failures_their_cause(finished):
    output, told = finished
    rows = {row["name"]: row for row in table(output)}
    assert {name for name, row in rows.items() if row["status"] == "done"} == set(GOOD)
    causes = {name: row["cause"] for name, row in rows.items() if row["status"] == "failed"}
    assert causes == {
        "bad-cut": "input",
        "bad-empty": "input",
        "bad-field": "input",
        "bad-missing": "input",
        "bad-nan": "input",
    }
    assert "none.obj" in rows["bad-missing"]["message"]
    assert all(row["seconds_inspect"] > 0 for row in rows.values() if row["status"] == "done")
    assert "3 done, 5 failed: bad input" in told
    schema = parquet.read_schema(output / "shapes.parquet")
    assert json.loads(schema.metadata[b"dfd-batch"])["steps"][0] == "inspect"


def test_a_shape_has_what_each_step_makes(finished, shapes):
    output, _ = finished
    made = output / "shapes" / "large"
    record = Record.model_validate_json((made / "record.json").read_text())
    assert record.files == [
        "features.npz",
        "features.png",
        "inspect.json",
        "leg.edit.json",
        "leg.ply",
        "leg.png",
        "symmetry.json",
        "thumbnail.png",
    ]
    assert sorted(path.name for path in made.iterdir()) == sorted([*record.files, "record.json"])
    mesh = dfd.load(shapes / "large.ply")
    with np.load(made / "features.npz") as small:
        rows = small["rows"].astype(np.float32) @ small["basis"].T + small["mean"]
    assert np.abs(rows - field_of(mesh)(mesh.vertices)).max() < 0.1
    assert np.abs(dfd.load(made / "leg.ply").vertices - mesh.vertices).max() > 0.3
    assert record.figures["leg_confidence"] == pytest.approx(1.0, abs=1e-2)
    assert record.memory > 50 << 20
    assert record.versions["dfd"]


def test_of_a_failure_nothing_stays_but_its_record(finished):
    output, _ = finished
    assert [path.name for path in (output / "shapes" / "bad-field").iterdir()] == ["record.json"]
    assert [path for path in (output / ".work").iterdir() if "~" in path.name] == []


def test_the_page_shows_every_shape_and_all_that_it_links_to_is_there(finished):
    output, _ = finished
    page = (output / "index.html").read_text()
    assert page.count("<article") == 8
    assert page.index("bad-cut") < page.index("thumbnail.png")
    links = re.findall(r"(?:href|src)='([^']+)'", page)
    assert all((output / unquote(link)).exists() for link in links)
    assert "://" not in page


def run(shapes_of: list[Shape], root: Path, limits: Limits | None = None, **how: object) -> tuple[Summary, Quiet]:
    settings = BatchSettings(steps=("inspect",))
    slots, quiet = ProcessSlots([{}]), Quiet()
    try:
        folder = BatchFolder.begin(root, settings)
        return run_batch(shapes_of, settings, folder, slots, limits or Limits(), quiet, **how), quiet
    finally:
        slots.close()


def test_a_run_does_what_is_missing_changed_or_to_be_tried_again(chair_mesh, tmp_path):
    for name in ("a", "b"):
        chair_mesh.save(tmp_path / f"{name}.ply")
    (tmp_path / "c.ply").write_text("no mesh")
    root, found = tmp_path / "out", find_shapes([f"{tmp_path}/*.ply"])
    summary, quiet = run(found, root)
    assert (summary.done, summary.failed, summary.missing) == (2, 1, 0)
    assert quiet.ended_names == ["a.ply", "b.ply", "c.ply"]
    assert run(found, root)[1].ended_names == []
    os.utime(tmp_path / "b.ply", ns=(1, 1))
    assert run(found, root)[1].ended_names == ["b.ply"]
    chair_mesh.save(tmp_path / "d.ply")
    summary, quiet = run(find_shapes([f"{tmp_path}/*.ply"]), root, retry=True)
    assert quiet.ended_names == ["c.ply", "d.ply"]
    assert (quiet.total, quiet.finished, len(table(root))) == (4, 2, 4)


def test_ranks_share_the_shapes_and_the_last_writes_the_table(shapes, tmp_path):
    found = [Shape(f"{name}-{number}", str(shapes / f"{name}.ply")) for name in GOOD for number in range(2)]
    summary, first = run(found, tmp_path / "out", rank=1, world_size=2)
    assert summary.missing == 3
    assert not (tmp_path / "out" / "shapes.parquet").exists()
    summary, second = run(found, tmp_path / "out", rank=0, world_size=2)
    assert summary.missing == 0
    assert sorted(first.ended_names + second.ended_names) == sorted(shape.name for shape in found)
    assert len(table(tmp_path / "out")) == 6


def test_a_shape_that_hangs_is_given_up_and_harms_no_other(shapes, tmp_path):
    found = [Shape("bad-hangs", str(shapes / "bad-hangs.obj")), Shape("cut", str(shapes / "bad-cut.glb"))]
    summary, quiet = run(found, tmp_path / "out", Limits(timeout=3.0))
    assert dict(summary.causes) == {"timeout": 1, "input": 1}
    assert quiet.ended_names == ["bad-hangs", "cut"]
    record = BatchFolder(tmp_path / "out", sharded=False).record("bad-hangs")
    assert record.message.startswith("took longer than 3 s, in read (dfd/batch/steps.py, line ")
    assert record.seconds >= 2.9


def test_a_shape_that_takes_too_much_memory_is_given_up(shapes, tmp_path):
    found = [Shape("chair", str(shapes / "chair.ply"))]
    summary, _ = run(found, tmp_path / "out", Limits(memory=1 << 20))
    assert dict(summary.causes) == {"memory": 1}


def processes(root: Path) -> dict[str, int]:
    """Which process is at which shape."""
    found = {}
    for owner in root.glob(".work/*~*/owner"):
        try:
            found[owner.parent.name.partition("~")[0]] = int(owner.read_text().split()[0])
        except (OSError, ValueError, IndexError):
            continue
    return found


def wait_for(what, *, seconds: float = 120.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := what():
            return found
        time.sleep(0.02)
    raise AssertionError("it never came")


def test_a_worker_that_is_killed_loses_nothing(shapes, tmp_path):
    """One that is killed once is forgiven; a shape that no worker survives is a failure of its own."""
    root = tmp_path / "out"
    found = [Shape("bad-hangs", str(shapes / "bad-hangs.obj")), Shape("chair", str(shapes / "chair.ply"))]
    killed: list[int] = []

    def kill() -> None:
        while len(killed) < 2:
            process = wait_for(lambda: processes(root).get("bad-hangs"))
            if process not in killed:
                os.kill(process, signal.SIGKILL)
                killed.append(process)

    killer = threading.Thread(target=kill)
    killer.start()
    summary, quiet = run(found, root)
    killer.join()
    assert (summary.done, dict(summary.causes)) == (1, {"crash": 1})
    assert quiet.ended_names == ["chair", "bad-hangs"]
    record = BatchFolder(root, sharded=False).record("bad-hangs")
    assert record.attempts == 2
    assert record.message == "its process was ended by SIGKILL, as the system does when memory runs out, 2 times"


def test_a_driver_that_is_killed_loses_nothing_and_its_workers_leave(shapes, finished, tmp_path):
    output = tmp_path / "out"
    driver = subprocess.Popen(command(shapes, output), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    kept = wait_for(lambda: list(output.glob("shapes/*/record.json")))
    workers = list(processes(output).values())
    driver.kill()
    driver.wait()
    before = {path: path.stat().st_mtime_ns for path in kept}
    wait_for(lambda: not any(psutil.pid_exists(process) for process in workers))
    for seconds in np.random.default_rng(0).uniform(0.5, 4, 3):  # and again, at whatever it is
        with subprocess.Popen(command(shapes, output), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as driver:
            time.sleep(seconds)
            driver.kill()
    done = subprocess.run(command(shapes, output), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1, done.stderr
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert [[row[key] for key in WITHOUT_TIMES] for row in table(output)] == [
        [row[key] for key in WITHOUT_TIMES] for row in table(finished[0])
    ]
    assert list((output / ".work").glob("*~*")) == []


def test_an_interruption_says_how_to_go_on_and_leaves_nobody_at_work(shapes, tmp_path):
    root = tmp_path / "out"
    Path(tmp_path / "hangs.csv").write_text(f"path\n{shapes / 'bad-hangs.obj'}\n")
    parts = ("batch", str(tmp_path / "hangs.csv"), "-o", str(root), "--step", "inspect", "--workers", "1")
    with subprocess.Popen([sys.executable, "-c", HEED, *parts], stderr=subprocess.PIPE, text=True) as driver:
        try:
            worker = wait_for(lambda: processes(root).get("bad-hangs.obj"))
            driver.send_signal(signal.SIGINT)
            _, told = driver.communicate(timeout=60)
        finally:
            driver.kill()
    assert driver.returncode == 130
    assert told.splitlines()[-1] == (f"dfd: interrupted: the same command goes on from here; what is done is in {root}")
    wait_for(lambda: not psutil.pid_exists(worker))


@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed: pip install 'dfd[batch]'")
def test_ray_makes_the_same_table_although_a_worker_is_killed(shapes, finished, tmp_path):
    output = tmp_path / "out"
    with subprocess.Popen(command(shapes, output, "--ray"), stderr=subprocess.PIPE, text=True) as done:
        good = wait_for(lambda: [process for name, process in processes(output).items() if name in GOOD])
        os.kill(good[0], signal.SIGKILL)
        _, told = done.communicate(timeout=400)
    assert "3 done, 5 failed: bad input" in told
    assert done.returncode == 1
    assert [[row[key] for key in WITHOUT_TIMES] for row in table(output)] == [
        [row[key] for key in WITHOUT_TIMES] for row in table(finished[0])
    ]
