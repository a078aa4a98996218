"""Runs that are stopped: killed, interrupted or out of memory, they resume at the next picture, or say why not."""

from __future__ import annotations

import errno
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_field import same
from stopped_runs import FEW_NODES, SMALL, count_work, interrupted, stop_at_fit

import dfd
import dfd.distillation.algorithm
import dfd.encoders.encode
from dfd import Field, Mesh
from dfd.common.progress import Stages
from dfd.distillation.checkpoint import Checkpoint
from dfd.distillation.distill import distilling
from dfd.distillation.settings import DistillSettings
from dfd.encoders.encode import Encoder

pytestmark = pytest.mark.usefixtures("one_thread")


def count_calls(monkeypatch: pytest.MonkeyPatch, name: str) -> list[int]:
    """Numbers of arguments of the calls of a function that still does what it did."""
    module, _, function = name.rpartition(".")
    original, calls = getattr(sys.modules[module], function), list[int]()
    monkeypatch.setattr(name, lambda *given: calls.append(len(given)) or original(*given))
    return calls


def test_a_run_that_was_interrupted_in_its_fit_encodes_nothing_again(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    interrupted(mesh, encoder, folder, monkeypatch)
    assert sorted(path.name.partition("-")[0] for path in folder.iterdir()) == ["recipe.json", *["tokens"] * 6]
    (folder / "fit-0123").write_bytes(b"what an older version has left")
    encoded = count_work(monkeypatch)
    assert same(dfd.distill(mesh, encoder, checkpoint=folder, **SMALL), whole)
    assert encoded == []
    assert list(tmp_path.iterdir()) == []


def test_pictures_that_were_encoded_are_not_encoded_again(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, written = Checkpoint.write_tokens, list[int]()

    def third_stops(self: Checkpoint, *given: Any) -> None:
        if len(written) == 2:
            raise KeyboardInterrupt
        written.append(len(given))
        write(self, *given)

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoint, "write_tokens", third_stops)
        with pytest.raises(KeyboardInterrupt):
            dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **SMALL)
    encoded = count_work(monkeypatch)
    assert same(dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **SMALL), whole)
    assert sum(encoded) == 4


def test_images_are_looked_at_only_where_tokens_were_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image, tokens = np.zeros((8, 8, 3), np.uint8), np.ones((2, 2, 3), np.float32)
    key = {"field_version": 1, "mesh": "some"}
    looks = count_calls(monkeypatch, "dfd.distillation.checkpoint.hash_arrays")
    fresh = Checkpoint(tmp_path / "run", key)
    assert fresh.read_tokens(image, None) is None
    assert looks == []
    fresh.write_tokens(image, None, tokens)
    for checkpoint in (fresh, Checkpoint(tmp_path / "run", key)):
        found = checkpoint.read_tokens(image, None)
        assert found is not None
        np.testing.assert_array_equal(found, tokens)
        assert checkpoint.read_tokens(image + 1, None) is None


def test_a_run_with_a_checkpoint_gives_what_one_without_gives(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path
) -> None:
    loaded = dfd.encoders.encode.load_encoder(encoder, device="cpu")
    assert same(dfd.distill(mesh, loaded, checkpoint=tmp_path / "run", **SMALL), whole)
    assert list(tmp_path.iterdir()) == []


def test_given_features_leave_no_folder(mesh: Mesh, tmp_path: Path) -> None:
    settings = {"features": np.random.default_rng(0).normal(size=(len(mesh.vertices), 4)), "steps": 20, "batch": 64}
    settings |= {"device": "cpu", "progress": False, "cache": False}
    with pytest.raises(ValueError, match="`learning_rate`"):
        dfd.distill(mesh, checkpoint=tmp_path / "run", **settings, learning_rate=1e30)
    assert same(dfd.distill(mesh, checkpoint=tmp_path / "run", **settings), dfd.distill(mesh, **settings))
    assert list(tmp_path.iterdir()) == []


def start(mesh: Path, encoder: Path, output: Path) -> subprocess.Popen[str]:
    """The command line with the settings of `SMALL`, slowed down by 150 ms a picture."""
    code = (
        "import signal, sys, time; signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # nohup ignores it
        "import dfd; dfd.set_num_threads(1)\n"
        f"from dfd.distillation import smoothing; smoothing.SURFACE_SAMPLES = {FEW_NODES}\n"
        "from dfd.distillation.checkpoint import Checkpoint\n"
        "write = Checkpoint.write_tokens\n"
        "def slow(*given): write(*given); time.sleep(0.15)\n"
        "Checkpoint.write_tokens = slow\n"
        "from dfd.cli import main; main(sys.argv[1:])"
    )
    options = ("--views", 6, "--resolution", 32, "--steps", 40, "--batch", 64, "--device", "cpu", "--no-cache")
    arguments = ("distill", mesh, "-o", output, "--encoder", encoder, *options)
    return subprocess.Popen([sys.executable, "-c", code, *map(str, arguments)], stderr=subprocess.PIPE, text=True)


def wait_for_tokens(process: subprocess.Popen[str], partial: Path, count: int) -> None:
    """Until the process has kept the tokens of so many pictures."""
    limit = time.monotonic() + 120
    while len(list(partial.glob("tokens-*"))) < count:
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < limit
        time.sleep(0.005)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_killed_command_resumes_at_the_next_picture(encoder: Path, mesh: Mesh, tmp_path: Path) -> None:
    shape, output = tmp_path / "chair.obj", tmp_path / "chair.safetensors"
    partial = tmp_path / "chair.safetensors.partial"
    mesh.save(shape)
    wanted = dfd.distill(dfd.load(shape), str(encoder), **SMALL)

    with start(shape, encoder, output) as process:
        wait_for_tokens(process, partial, 1)
        process.kill()
        process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    kept = len(list(partial.glob("tokens-*")))
    with start(shape, encoder, output) as process:
        wait_for_tokens(process, partial, kept + 1)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    message = f"dfd: interrupted: the same command goes on from here; what is done is in {partial}"
    assert error.splitlines()[-1] == message
    assert sorted(tmp_path.iterdir()) == [shape, partial]
    assert len(list(partial.glob("tokens-*"))) > kept

    assert same(dfd.distill(dfd.load(shape), str(encoder), checkpoint=partial, **SMALL), wanted)
    assert list(tmp_path.iterdir()) == [shape]


def test_other_settings_restart_and_say_so(
    encoder: Path, mesh: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    other = {**SMALL, "steps": 5}
    with pytest.warns(UserWarning, match=r"run was made with other settings \(steps 40, now 5\): the run is restarted"):
        field = dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **other)
    assert same(field, dfd.distill(mesh, encoder, **other))
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    moved = Mesh(mesh.vertices * 2, mesh.faces)
    with pytest.warns(UserWarning, match=r"other settings \(another mesh\)"):
        dfd.distill(moved, encoder, checkpoint=tmp_path / "run", **SMALL)


def test_a_field_from_the_cache_leaves_no_checkpoint(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    interrupted(mesh, encoder, tmp_path / "run", monkeypatch)
    interrupted(Mesh(mesh.vertices * 2, mesh.faces), encoder, tmp_path / "other", monkeypatch)
    settings = {**SMALL, "cache": True}
    assert same(dfd.distill(mesh, encoder, **settings), whole)
    for folder in ("run", "other"):
        assert same(dfd.distill(mesh, encoder, checkpoint=tmp_path / folder, **settings), whole)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "other"]


def test_a_fit_that_cannot_succeed_keeps_nothing(encoder: Path, mesh: Mesh, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="`learning_rate` 1e\\+30 is too high"):
        dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", learning_rate=1e30, **SMALL)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("where", "error", "message"),
    [
        (
            "render",
            np._core._exceptions._ArrayMemoryError((10**9,), np.dtype("f8")),
            "the pictures: lower `resolution`",
        ),
        ("encode", MemoryError(), "the tokens: lower `resolution` or `views`, or take a smaller encoder"),
        ("fit", RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory"), "the fit: lower `batch`"),
    ],
)
def test_out_of_memory_says_what_to_lower(
    encoder: Path,
    mesh: Mesh,
    whole: Field,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    where: str,
    error: Exception,
    message: str,
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    with monkeypatch.context() as patch:
        if where == "fit":
            stop_at_fit(patch, error)
        elif where == "encode":
            patch.setattr(Encoder, "_forward", fail)
        else:
            patch.setattr(dfd.distillation.algorithm, "render", fail)
        with pytest.raises(MemoryError, match=f"distill: too little memory for {message}"):
            dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **SMALL)
    assert same(dfd.distill(mesh, encoder, checkpoint=tmp_path / "run", **SMALL), whole)


def test_other_errors_stay_what_they_are(encoder: Path, mesh: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr(dfd.distillation.algorithm, "render", fail)
    with pytest.raises(RuntimeError, match="a bug"):
        dfd.distill(mesh, encoder, **SMALL)


def test_a_field_that_cannot_be_saved_in_the_end_leaves_the_checkpoint(
    encoder: Path, mesh: Mesh, whole: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = DistillSettings(**{name: SMALL[name] for name in ("views", "resolution", "steps", "batch")})
    how = {"device": "cpu", "stages": Stages(show=False), "cache": False, "checkpoint": tmp_path / "run"}
    with pytest.raises(OSError, match="No space left"), distilling(mesh, encoder, settings, **how):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert len(list((tmp_path / "run").glob("tokens-*"))) == 6
    encoded = count_work(monkeypatch)
    with distilling(mesh, encoder, settings, **how) as field:
        assert (tmp_path / "run").exists()
    assert encoded == []
    assert same(field, whole)
    assert list(tmp_path.iterdir()) == []
