"""Check that an installed wheel binds, poses and evaluates a field, with and without torch.

Run `python tests/wheel/smoke.py` by the Python of the wheel's environment. If torch is installed, both must share one
OpenMP runtime. With `--page`, the app's page and the notices of its libraries must be there.
"""

import importlib.util
import sys
from importlib import metadata
from pathlib import Path

import numpy as np

import dfd
import dfd._core as _core
from dfd.common.distribution import DISTRIBUTION
from dfd.field.architecture import Architecture

WITH_TORCH = importlib.util.find_spec("torch") is not None
MAPS = Path("/proc/self/maps")


def main() -> None:
    """Compute weights, poses and features on one thread and on three, and compare them with expected values."""
    random = np.random.default_rng(0)
    features = random.standard_normal((5000, 24)).astype(np.float32)
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    vertices = random.standard_normal((5000, 3))
    field = random_field(random)
    results = []
    for threads in (1, 3):
        dfd.set_num_threads(threads)
        weights = dfd.bind(features, [0, 17])
        lifted = np.tile(np.eye(3, 4), (2, 1, 1))
        lifted[0, 1, 3] = 0.5
        results.append((weights, dfd.pose(vertices, weights, lifted), field(vertices)))
    for once, again in zip(*results, strict=True):
        np.testing.assert_array_equal(once, again)
    weights, posed, rows = results[0]
    expected = np.maximum(1 - np.linalg.norm(features.astype(float)[:, None] - features[[0, 17]], axis=2), 0)
    np.testing.assert_allclose(weights, expected, atol=2e-4)
    np.testing.assert_allclose(posed[:, 1] - vertices[:, 1], 0.5 * weights[:, 0], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-5)
    assert "torch" not in sys.modules, "dfd imported torch"
    if "--page" in sys.argv:
        page()
    if WITH_TORCH:
        beside_torch(features, results[0][0])
    print(sys.version.split()[0], *_core.instruction_sets(), "beside torch" if WITH_TORCH else "without torch")


def page() -> None:
    """Check that the app's page was installed, with the notices of the libraries that it contains."""
    assert (Path(dfd.__file__).parent / "app/static/index.html").is_file(), "the app's page is missing"
    files = [str(path) for path in metadata.files(DISTRIBUTION) or ()]
    for notice in ("LICENSE", "THIRD_PARTY.md", "docs/learned.md"):
        assert any(path.endswith(f"licenses/{notice}") for path in files), f"{notice} is missing"


def random_field(random: np.random.Generator) -> dfd.Field:
    """Return a small field with random weights."""
    parameters = {
        name: (random.standard_normal(shape) / np.sqrt(shape[-1])).astype(np.float32)
        for name, shape in Architecture(8, 32, 2, 4).shapes().items()
    }
    return dfd.Field(parameters, octaves=4)


def beside_torch(features: np.ndarray, wanted: np.ndarray) -> None:
    """Check that bind accepts and returns tensors, and that the process has loaded one OpenMP runtime."""
    import torch

    square = torch.ones(400, 400)
    assert bool((square @ square == 400).all())
    weights = dfd.bind(torch.from_numpy(features), [0, 17])
    assert torch.equal(weights, torch.from_numpy(wanted))
    if MAPS.exists():
        loaded = {line.split()[-1] for line in MAPS.read_text().splitlines() if "gomp" in line.split()[-1]}
        assert len(loaded) <= 1, f"two OpenMP runtimes: {loaded}"


if __name__ == "__main__":
    main()
