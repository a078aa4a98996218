"""Keys: equal by content, and of one version of how fields are made."""

from __future__ import annotations

import numpy as np

from dfd.field.cache_key import hash_arrays


def test_arrays_are_told_apart_by_type_shape_and_content() -> None:
    hashes = {
        hash_arrays(np.zeros(4, np.float32)),
        hash_arrays(np.zeros(2, np.float64)),
        hash_arrays(np.zeros((2, 2), np.float32)),
        hash_arrays(np.ones(4, np.float32)),
        hash_arrays(np.zeros(2, np.float32), np.zeros(2, np.float32)),
    }
    assert len(hashes) == 5
    rows = np.arange(6.0).reshape(2, 3)
    assert hash_arrays(rows.T) == hash_arrays(np.ascontiguousarray(rows.T))
