"""What sessions of one server share, on disk and in memory."""

from __future__ import annotations

import os
import queue
import re
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_field import field_of
from mesh_files import obj_cube

import dfd
from dfd.app import shared
from dfd.app.options import OpenedFile, SessionOptions, Source
from dfd.app.session.session import Session
from dfd.app.shared import SharedValues

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sessions share nothing there")


def backed_by_one_file(one: Any, other: Any, folder: Path) -> bool:
    """Whether a byte changed in a file of `folder` changes in both arrays."""
    bits = one.tobytes()
    for path in (each for each in folder.iterdir() if not each.suffix):
        places = [found.start() for found in re.finditer(re.escape(bits), path.read_bytes())]
        for at in places:
            with path.open("r+b", buffering=0) as file:
                os.pwrite(file.fileno(), bytes([bits[0] ^ 1]), at)
                changed = [each.tobytes() != bits for each in (one, other)]
                os.pwrite(file.fileno(), bits[:1], at)
            if any(changed):
                return all(changed)
    return False


def test_a_value_is_made_once_and_its_arrays_are_one_file_that_nobody_writes_to(tmp_path: Path) -> None:
    made: list[int] = []

    def make() -> dict[str, Any]:
        made.append(1)
        rows = np.arange(24.0).reshape(4, 6)
        return {"rows": rows, "again": rows, "strided": rows[:, ::2], "across": rows.T, "none": rows[:0], "text": "é"}

    folder = tmp_path / "shared"
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda _: SharedValues(folder).value("rows", make), range(8)))
    assert made == [1]
    assert backed_by_one_file(found[0]["rows"], found[7]["rows"], folder)
    for each in found:
        assert all(not array.flags.writeable for name, array in each.items() if name != "text")
        assert each["again"] is each["rows"]
        for name, value in make().items():
            np.testing.assert_array_equal(each[name], value)
    assert folder.stat().st_mode & 0o77 == 0
    assert all(path.stat().st_mode & 0o77 == 0 for path in folder.iterdir() if not path.suffix)


def test_what_every_process_has_stays_outside(tmp_path: Path) -> None:
    ours, theirs = np.ones(3), np.ones(3)
    values = SharedValues(tmp_path)
    assert values.value("pair", lambda: (ours, 2), known=[ours])[0] is ours
    assert values.value("pair", list, known=[theirs]) == (theirs, 2)  # type: ignore[comparison-overlap]


def test_what_failed_or_was_killed_is_made_again_and_what_nobody_uses_goes(tmp_path: Path) -> None:
    values = SharedValues(tmp_path)
    with pytest.raises(ValueError, match="no such shape"):
        values.value("a", lambda: (_ for _ in ()).throw(ValueError("no such shape")))
    rows = values.value("a", lambda: np.ones(9))
    (file,) = (path for path in tmp_path.iterdir() if not path.suffix)
    half = file.with_suffix(".written")
    half.write_bytes(b"half of it")  # by a process that was killed
    values.value("b", lambda: 2)
    assert file.exists(), "rows are still in use"
    assert not half.exists()
    del rows
    values.value("c", lambda: 3)
    assert not file.exists()
    assert values.value("a", lambda: np.zeros(9)).tolist() == [0] * 9


def test_where_nothing_can_be_written_a_session_has_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert SharedValues(None).value("a", lambda: 1) == 1
    assert SharedValues(tmp_path / "is not" / "there").value("a", lambda: 1) == 1

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shared, "_write", full)
    assert SharedValues(tmp_path).value("a", lambda: 1) == 1


def test_compact_features_weigh_the_same(tmp_path: Path) -> None:
    features = np.random.default_rng(0).normal(size=(40, 8))
    own = dfd.compact(features / np.linalg.norm(features, axis=1, keepdims=True))
    found, again = (SharedValues(tmp_path).value("features", lambda: own) for _ in range(2))
    assert not found.blocks.flags.writeable
    assert backed_by_one_file(found.blocks, again.blocks, tmp_path)
    np.testing.assert_array_equal(dfd.bind(found, [3, 7]), dfd.bind(own, [3, 7]))


def test_a_shape_whose_material_was_written_since_is_read_again(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl q\nKd 1 0 0\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl q\n" + obj_cube())
    values, source = SharedValues(tmp_path / "shared"), Source(name="a", path=tmp_path / "a.obj")
    first, again = values.shape(source)[0], values.shape(source)[0]
    assert backed_by_one_file(first.vertices, again.vertices, tmp_path / "shared")
    (tmp_path / "a.mtl").write_text("newmtl q\nKd 0 0 1.0\n")
    mesh, _, key = values.shape(source)
    assert mesh.vertex_colors()[0].tolist() == [0, 0, 1, 1]
    assert first.vertex_colors()[0].tolist() == [1, 0, 0, 1]
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl q\n" + obj_cube() + "\n")
    assert values.shape(source)[2] != key
    first.save(tmp_path / "saved.obj", first.vertices + 1)
    assert (dfd.load(tmp_path / "saved.obj").vertices == first.vertices + 1).all()


def begun(folder: Path, options: SessionOptions) -> Session:
    """A session, once its shape has its parts."""
    calls: queue.Queue[Callable[[], None]] = queue.Queue()
    folder.mkdir()
    session = Session(folder, options, lambda message: None, calls.put, server_folder=folder.parent)
    session.begin()
    while session.view_state.parts is None or not session.view_state.parts.ready:
        calls.get(timeout=60)()
    return session


@pytest.fixture(scope="module")
def options(chair_mesh: dfd.Mesh, tmp_path_factory: pytest.TempPathFactory) -> SessionOptions:
    folder = tmp_path_factory.mktemp("chair")
    chair_mesh.save(folder / "chair.glb")
    field_of(chair_mesh).save(folder / "made.safetensors")
    return SessionOptions(
        mesh=Source(name="chair", path=folder / "chair.glb"),
        field=OpenedFile(name="made", path=folder / "made.safetensors"),
    )


def test_two_sessions_have_one_shape_and_each_its_own_edit(
    tmp_path: Path, options: SessionOptions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dfd.symmetry.search.symmetry_planes", lambda *_, **__: [])  # most of the time
    one, other = (begun(tmp_path / name, options) for name in ("one", "other"))
    assert one.deformer is not None
    assert other.deformer is not None
    assert one.mesh is not None
    assert other.mesh is not None
    ours, theirs = one.deformer.bound, other.deformer.bound
    for mine, yours in (
        (one.mesh.vertices, other.mesh.vertices),
        (one.mesh.faces, other.mesh.faces),
        (one.mesh.normals, other.mesh.normals),
        (ours.features, theirs.features),
        (ours.finder._nodes.members, theirs.finder._nodes.members),
        (ours.parts._patches.of_vertex, theirs.parts._patches.of_vertex),
    ):
        assert not mine.flags.writeable
        assert backed_by_one_file(mine, yours, tmp_path / "shared")
    assert ours.parts._patches.nodes is ours.finder._nodes
    assert ours.parts._mesh is one.mesh

    alone = dfd.Deformer(one.mesh, one.deformer.field)
    for session in (one.deformer, alone):
        session.add(5, translation=(0, 0.2, 0), locality=1.0)
        session.fix(900)
    np.testing.assert_array_equal(one.deformer.vertices, alone.vertices)
    np.testing.assert_array_equal(other.deformer.vertices, other.mesh.vertices)
    assert one.deformer.part(5) == alone.part(5)
