"""Make features for the tests of binding."""

import numpy as np


def unit_rows(count, dimension, *, seed=0, spread=0.5):
    """Return (count, dimension) float32 unit rows that scatter around one direction, as the features of a shape do."""
    random = np.random.default_rng(seed)
    rows = random.standard_normal(dimension) + spread * random.standard_normal((count, dimension))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)
