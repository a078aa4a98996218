"""What others need for the same work."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from dfd.common.linear_algebra import Float32, Float64, Int64


def torch_binding(features: Float32, handles: Int64) -> Callable[[], object]:
    """The arithmetic of the public reference: rows of the distance matrix, clamped."""
    rows = torch.from_numpy(features)
    if len(handles) == 1:
        index = int(handles[0])
        return lambda: (1 - torch.linalg.norm(rows - rows[index], dim=1)).clamp(0, 1)
    chosen = rows[torch.from_numpy(handles)]
    return lambda: (1 - torch.cdist(rows, chosen)).clamp(0, 1)


def torch_blending(vertices: Float32, weights: Float32, transforms: Float64) -> Callable[[], object]:
    """The arithmetic of the public reference: a 4 x 4 matrix a vertex, blended and applied by batched products."""
    points = torch.from_numpy(np.concatenate([vertices, np.ones((len(vertices), 1), np.float32)], axis=1))[:, :, None]
    factors = torch.from_numpy(weights)
    square = np.tile(np.eye(4, dtype=np.float32), (len(transforms), 1, 1))
    square[:, :3] = transforms
    moves = torch.from_numpy(square)
    identity = torch.eye(4)

    def call() -> torch.Tensor:
        left = (1 - factors.sum(dim=1)).clamp(min=0)
        blended = left[:, None, None] * identity + (factors[:, :, None, None] * moves[None]).sum(dim=1)
        return torch.bmm(blended, points)[:, :3, 0]

    return call


def igl_blending(vertices: Float32, weights: Float32, transforms: Float64) -> Callable[[], object]:
    """The product of libigl's skinning matrix, made beforehand, with the stacked transforms."""
    import igl

    matrix = igl.lbs_matrix(vertices.astype(np.float64), np.ascontiguousarray(weights, np.float64))
    stacked = np.ascontiguousarray(transforms.transpose(0, 2, 1).reshape(-1, 3))
    return lambda: matrix @ stacked
