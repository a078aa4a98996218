"""Smooth normals of a surface after a few of its vertices move."""

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int32
from dfd.mesh.normals import smooth_normals


def updated_normals(normals: Float32, before: Float64, after: Float64, faces: Int32) -> Float32:
    """Return `smooth_normals(after, faces)`, computed only around moved vertices.

    `normals` (V, 3) are the normals at the positions `before` (V, 3).
    """
    moved = (after != before).any(axis=1)
    turned = np.zeros(len(moved), bool)
    first, second, third = faces.T
    turned[faces[moved[first] | moved[second] | moved[third]]] = True
    if 3 * np.count_nonzero(turned) > len(turned):
        return smooth_normals(after, faces)
    around = faces[turned[first] | turned[second] | turned[third]]
    used = np.bincount(around.ravel(), minlength=len(moved)) > 0
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    updated = normals.copy()
    if len(around):
        updated[turned] = smooth_normals(after[used], number[around])[turned[used]]
    return updated
