"""Test the page in a real browser with the real server, by the scripts of the client's tests.

The tests need Node with the client's packages (`npm ci`), the built page, and Chromium or Chrome. They are skipped if
one is missing. The scripts save screenshots in build/screens.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from app_page import CLIENT, SCREENS, Shape
from mesh_files import header_and_data

import dfd
from dfd.app.options import SessionOptions
from dfd.app.web.launch import RunningApp

MINUTES = 10


@pytest.fixture
def start_page(shape: Shape, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningApp]:
    """Return a server without a mesh, because the scripts open one."""
    monkeypatch.setenv("DFD_DATA", str(tmp_path / "data"))  # so that no story finds the edits of another
    settings = {**shape.settings, "cache": False}
    running = RunningApp(SessionOptions(encoder=str(shape.encoder), distill=settings))
    running.start()
    yield running
    running.stop()


STORIES = sorted(path.name for path in (CLIENT / "tests" / "browser").glob("*.test.mjs"))


@pytest.mark.browser
@pytest.mark.parametrize("story", STORIES)
def test_story(story: str, browser: str, start_page: RunningApp, animal: Shape, large: Path, tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "DFD_URL": start_page.url,
        "DFD_CHROMIUM": browser,
        "DFD_SHOTS": str(SCREENS),
        "DFD_MESH": str(animal.mesh),
        "DFD_FIELD": str(animal.field),
        "DFD_LARGE": str(large),
        "DFD_PYTHON": sys.executable,
        "DFD_ALIKE": json.dumps(animal.alike),
        "DFD_OUT": str(tmp_path),
    }
    done = subprocess.run(
        ["node", "--test", f"tests/browser/{story}"],
        cwd=CLIENT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60 * MINUTES,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    if (tmp_path / "seen.json").exists():
        assert_exported(tmp_path, animal)
    if (tmp_path / "moment.json").exists():
        assert_moment_exported(tmp_path, animal)


def assert_exported(folder: Path, shape: Shape) -> None:
    """Check that the exported files of all formats contain the shape that the page showed."""
    rest = dfd.load(shape.mesh)
    seen = np.reshape(json.loads((folder / "seen.json").read_text()), (-1, 3))
    assert np.abs(seen - rest.vertices).max() > 0.01 * rest.diagonal, "something moved"
    tolerance = 1e-4 * rest.diagonal
    for ending in ("glb", "obj", "ply", "stl"):
        made = dfd.load(folder / f"quadruped_edited.{ending}")
        assert len(made.faces) == len(rest.faces), ending
        corners = made.vertices[made.faces].reshape(-1, 3)
        np.testing.assert_allclose(corners, seen[rest.faces].reshape(-1, 3), atol=tolerance, err_msg=ending)
    animated = trimesh.load_scene(folder / "quadruped_poses.glb")
    header = header_and_data(folder / "quadruped_poses.glb")[0]
    times = [header["accessors"][each["input"]] for each in header["animations"][0]["samplers"]]
    assert {(each["min"][0], each["max"][0]) for each in times} == {(0.0, 1.0)}, "two key poses, a second apart"
    assert len(header["skins"][0]["joints"]) > 1
    assert sum(len(each.faces) for each in animated.geometry.values()) == len(rest.faces)


def assert_moment_exported(folder: Path, shape: Shape) -> None:
    """Check that the exported shape, rig and weights contain the bent shape that the timeline showed."""
    rest = dfd.load(shape.mesh)
    seen = np.reshape(json.loads((folder / "moment.json").read_text()), (-1, 3))
    assert np.abs(seen - rest.vertices).max() > 0.005 * rest.diagonal, "something moved"
    made = dfd.load(folder / "quadruped_moment.glb")
    corners = made.vertices[made.faces].reshape(-1, 3)
    np.testing.assert_allclose(corners, seen[rest.faces].reshape(-1, 3), atol=1e-4 * rest.diagonal)
    assert len(header_and_data(folder / "quadruped_rig.glb")[0]["skins"]) == 1
    with np.load(folder / "quadruped_weights.npz") as arrays:
        assert len(arrays["weights"]) == len(rest.vertices)
