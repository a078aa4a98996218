"""Make vertices, weights and transforms for the tests of posing."""

import numpy as np


def rotation(axis, angle):
    """Return the rotation matrix (3, 3) by `angle` in radians about `axis` (3,)."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def about(pivot, linear, translation=(0.0, 0.0, 0.0)):
    """Return the matrix (3, 4) that applies `linear` (3, 3) about `pivot`, and then `translation`."""
    matrix = np.empty((3, 4))
    matrix[:, :3], matrix[:, 3] = linear, pivot + np.asarray(translation) - linear @ pivot
    return matrix


def scene(vertex_count, handle_count, *, seed=0, dtype=np.float32):
    """Return random vertices, weights with sums below and above 1, and affine transforms."""
    random = np.random.default_rng(seed)
    vertices = random.standard_normal((vertex_count, 3)).astype(dtype)
    weights = (random.random((vertex_count, handle_count)) * 2.5 / max(handle_count, 1)).astype(np.float32)
    transforms = np.eye(3, 4) + 0.5 * random.standard_normal((handle_count, 3, 4))
    return vertices, weights, transforms


def turning_scene(vertex_count, handle_count, *, seed=0, dtype=np.float32, stretch=0.2):
    """Return a `scene` whose transforms rotate by up to 150° and stretch. Handle k is at vertex k, with weight 1."""
    random = np.random.default_rng(seed)
    vertices, weights, _ = scene(vertex_count, handle_count, seed=seed, dtype=dtype)
    transforms = np.empty((handle_count, 3, 4))
    for k in range(handle_count):
        turn = rotation(random.standard_normal(3), random.uniform(0, np.radians(150)))
        scale = np.eye(3) + stretch * np.diag(random.uniform(-1, 1, 3))
        axes = np.linalg.qr(random.standard_normal((3, 3)))[0]
        transforms[k, :, :3] = turn @ axes @ scale @ axes.T
        transforms[k, :, 3] = 0.5 * random.standard_normal(3)
        weights[k] *= 0.3
        weights[k, k] = 1
    return vertices, weights, transforms
