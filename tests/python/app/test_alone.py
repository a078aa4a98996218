"""The page without a server: the core as WebAssembly weighs as `dfd.bind`, and the story of such a page in a browser.

They need Node with the client's packages, `dfd.wasm` (`make wasm`) and for the story Chromium; what is missing is said.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from app_page import CLIENT, ROOT, SCREENS, Shape

import dfd
from dfd.app.session.surface import center_of
from docs.tools import shapes

WASM = ROOT / "build" / "wasm" / "cpp" / "wasm" / "dfd.wasm"


@pytest.fixture(scope="module")
def wasm() -> Path:
    """The module, or the reason why there is no test."""
    if shutil.which("node") is None or not (CLIENT / "node_modules" / "vite").is_dir():
        pytest.skip("Node or the client's packages are not installed: WebAssembly was not tested")
    if not WASM.is_file():
        pytest.skip("dfd.wasm is not built (make wasm): it was not tested")
    return WASM


def test_webassembly_weighs_as_bind_does(wasm: Path, tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    rows = random.standard_normal((5, 24))[random.integers(0, 5, 101)] + 0.15 * random.standard_normal((101, 24))
    features = shapes.stored((rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32))
    asked = [
        {"handles": [7], "reach": 2.0, "falloff": "linear", "fixed": []},
        {"handles": [3, 100, 41], "reach": 1.0, "falloff": "linear", "fixed": []},
        {"handles": [0, 1], "reach": 0.7, "falloff": "smooth", "fixed": [{"vertex": 9, "strength": 0.5}]},
        {"handles": [20], "reach": 1.3, "falloff": "sphere", "fixed": [{"vertex": v, "strength": 1} for v in (5, 6)]},
    ]
    (tmp_path / "features.bin").write_bytes(shapes.packed(features))
    (tmp_path / "asked.json").write_text(json.dumps({"vertices": 101, "asked": asked, "refused": [[101], [4, 4]]}))
    shutil.copy(wasm, tmp_path / "dfd.wasm")
    command = ["node", "tools/weights.mjs", str(tmp_path)]
    done = subprocess.run(command, cwd=CLIENT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "bind: `handles` must lie in 0 … 100, got 101",
        "bind: `handles` names vertex 4 more than once",
    ]
    expected = []
    for each in asked:
        fixed = [place["vertex"] for place in each["fixed"]]
        strength = [place["strength"] for place in each["fixed"]]
        options = {"fixed": fixed, "strength": strength} if fixed else {}
        weights = dfd.bind(features, each["handles"], reach=each["reach"], falloff=each["falloff"], **options)
        expected.append(weights.T.reshape(-1))
    found = np.fromfile(tmp_path / "weights.bin", np.float32)
    assert 0.05 < np.mean(found > 0) < 0.95
    np.testing.assert_allclose(found, np.concatenate(expected), rtol=0, atol=1e-6)


@pytest.mark.browser
def test_story_alone(
    wasm: Path, browser: str, animal: Shape, quadruped_sample: dfd.samples.Sample, tmp_path: Path
) -> None:
    place = tmp_path / "page"
    command = ["npm", "run", "--silent", "build:alone", "--", "--outDir", str(place)]
    subprocess.run(command, cwd=CLIENT, check=True, capture_output=True, timeout=120)
    shutil.copy(wasm, place / "dfd.wasm")
    mesh, sample = dfd.load(animal.mesh), quadruped_sample
    # To a field of one second a hind leg is not like a fore one: these features know a part, and a little of where.
    rows = np.zeros((len(sample.labels), 16), np.float32)
    rows[np.arange(len(rows)), sample.labels] = 1.0
    rows[:, 12:15] = 0.3 * np.abs(mesh.vertices)
    features = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    session = dfd.Deformer(mesh, dfd.Field.load(animal.field, mesh=mesh), features=features)
    shapes.write(session, "animal", place / "shapes" / "animal")
    shapes.write_session({"animal": mesh}, place / "shapes")
    with served(place) as address:
        environment = {
            **os.environ,
            "DFD_URL": address,
            "DFD_CHROMIUM": browser,
            "DFD_SHOTS": str(SCREENS),
            "DFD_OUT": str(tmp_path),
            "DFD_HELD": json.dumps(sample.vertices_of("leg").tolist()),
        }
        command = ["node", "--test", "tests/browser/alone/story.test.mjs"]
        done = subprocess.run(
            command, cwd=CLIENT, env=environment, capture_output=True, text=True, timeout=300, check=False
        )
    assert done.returncode == 0, done.stdout + done.stderr
    # What the shader posed lies where the session's own weights and Eq. 1 put it.
    told = json.loads((tmp_path / "alone.json").read_text())
    session.remove(session.handles[0].id)
    handle = told["handle"]
    session.add(handle["vertex"], translation=handle["translation"], instances="shared_pivot")
    moved = np.reshape(told["positions"], (-1, 3)) + center_of(mesh)
    way = np.linalg.norm(handle["translation"])
    assert way > 0.01 * mesh.diagonal
    off = np.linalg.norm(moved - session.vertices, axis=1) / way
    assert off.mean() < 0.03
    # One leg is held: all four follow, and the head stays.
    went = np.linalg.norm(moved - mesh.vertices, axis=1) / way
    hooves = [went[sample.vertices_of("hoof", number)].mean() for number in range(4)]
    assert min(hooves) > 0.8
    assert went[sample.vertices_of("head")].max() < 0.05


@contextlib.contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a plain server of files."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(QuietHandler, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


class QuietHandler(SimpleHTTPRequestHandler):
    """Says nothing of each file."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Write nothing."""
