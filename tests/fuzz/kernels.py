"""Inputs of the kernels: shapes of every remainder, values of every size; each result against the float64 twin."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import reference
from hypothesis import strategies as st

import dfd

__all__ = ["kernel_input", "run_kernels"]


def kernel_input() -> st.SearchStrategy[bytes]:
    """What `run_kernels` makes arrays of: sizes, a seed and the scale of the numbers."""
    numbers = {
        "vertices": st.integers(1, 70),
        "dimension": st.integers(1, 40),
        "handles": st.integers(0, 9),
        "fixed": st.integers(0, 4),
        "threads": st.sampled_from([1, 1, 3]),
        "seed": st.integers(0, 2**31),
        "exponent": st.integers(-30, 30),
        "locality": st.sampled_from([0.0, 0.5, 3.0, 1e30]),
    }
    return st.fixed_dictionaries(numbers).map(lambda drawn: json.dumps(drawn).encode())


def run_kernels(path: Path) -> None:
    """Bind and pose agree with their twins, stay within what they promise, and leave their inputs alone."""
    case = json.loads(path.read_bytes())
    random = np.random.default_rng(case["seed"])
    count, handle_count = case["vertices"], min(case["handles"], case["vertices"])
    features = random.standard_normal((count, case["dimension"])).astype(np.float32)
    features /= np.maximum(np.linalg.norm(features, axis=1, keepdims=True), 1e-6)
    handles = random.permutation(count)[:handle_count]
    fixed = random.permutation(count)[: min(case["fixed"], count)]
    geodesic = random.uniform(0, 1, (handle_count, count)).astype(np.float32)
    options = {"fixed": fixed, "geodesic": geodesic, "locality": case["locality"]}
    before = [array.copy() for array in (features, handles, fixed, geodesic)]
    dfd.set_num_threads(case["threads"])
    weights = dfd.bind(features, handles, **options)
    assert weights.shape == (count, handle_count)
    assert ((weights >= 0) & (weights <= 1)).all()
    np.testing.assert_allclose(weights, reference.bind(features, handles, **options), atol=2e-3)
    vertices = random.standard_normal((count, 3)) * 10.0 ** case["exponent"]
    transforms = np.tile(np.eye(3, 4), (handle_count, 1, 1)) + random.standard_normal((handle_count, 3, 4)) * 0.3
    transforms[:, :, 3] *= 10.0 ** case["exponent"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        posed = dfd.pose(vertices, weights, transforms)
    size = float(np.abs(vertices).max()) + float(np.abs(transforms[:, :, 3]).max(initial=0))
    np.testing.assert_allclose(
        posed, reference.pose(vertices, weights, transforms), atol=1e-5 * size * (1 + handle_count)
    )
    for array, copy in zip((features, handles, fixed, geodesic), before, strict=True):
        np.testing.assert_array_equal(array, copy)
