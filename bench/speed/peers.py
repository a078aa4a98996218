"""What others need for the same work. Every peer is optional: one that is missing or fails is reported so."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

__all__ = ["MESH_PEERS", "igl_blending", "torch_binding", "torch_blending"]


def torch_binding(features: NDArray[np.float32], handles: NDArray[np.int64]) -> Callable[[], object]:
    """The arithmetic of the public reference: rows of the distance matrix, clamped."""
    rows = torch.from_numpy(features)
    if len(handles) == 1:
        index = int(handles[0])
        return lambda: (1 - torch.linalg.norm(rows - rows[index], dim=1)).clamp(0, 1)
    chosen = rows[torch.from_numpy(handles)]
    return lambda: (1 - torch.cdist(rows, chosen)).clamp(0, 1)


def torch_blending(
    vertices: NDArray[np.float32], weights: NDArray[np.float32], transforms: NDArray[np.float64]
) -> Callable[[], object]:
    """The arithmetic of the public reference: a 4 x 4 matrix a vertex, blended and applied by batched products."""
    places = torch.from_numpy(np.concatenate([vertices, np.ones((len(vertices), 1), np.float32)], axis=1))[:, :, None]
    factors = torch.from_numpy(weights)
    square = np.tile(np.eye(4, dtype=np.float32), (len(transforms), 1, 1))
    square[:, :3] = transforms
    moves = torch.from_numpy(square)
    identity = torch.eye(4)

    def call() -> torch.Tensor:
        left = (1 - factors.sum(dim=1)).clamp(min=0)
        blended = left[:, None, None] * identity + (factors[:, :, None, None] * moves[None]).sum(dim=1)
        return torch.bmm(blended, places)[:, :3, 0]

    return call


def igl_blending(
    vertices: NDArray[np.float32], weights: NDArray[np.float32], transforms: NDArray[np.float64]
) -> Callable[[], object]:
    """The product of libigl's skinning matrix, made beforehand, with the stacked transforms."""
    import igl

    matrix = igl.lbs_matrix(vertices.astype(np.float64), np.ascontiguousarray(weights, np.float64))
    stacked = np.ascontiguousarray(transforms.transpose(0, 2, 1).reshape(-1, 3))
    return lambda: matrix @ stacked


# Peers that need a mesh. Each takes (vertices, faces) and does its work once for one handle, 10 or more fixed points.


def _constraints(vertices: NDArray[Any]) -> NDArray[np.int64]:
    return np.linspace(0, len(vertices) - 1, 10).astype(np.int64)


def potpourri_heat(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> dict[str, Callable[[], object]]:
    """Geodesic distances by the heat method."""
    import potpourri3d

    made: list[Any] = []
    return {
        "preprocess": lambda: made.append(potpourri3d.MeshHeatMethodDistanceSolver(vertices, faces)),
        "bind": lambda: made[-1].compute_distance(0),
    }


def igl_arap(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> dict[str, Callable[[], object]]:
    """As-rigid-as-possible deformation: the factorisation belongs to the handles, the solve to the pose."""
    import igl

    fixed = _constraints(vertices).astype(np.int32)
    data = igl.ARAPData()
    return {
        "bind": lambda: igl.arap_precomputation(vertices, faces.astype(np.int64), 3, fixed, data),
        "pose": lambda: igl.arap_solve(vertices[fixed] + 0.01, data, vertices.copy()),
    }


def igl_biharmonic(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> dict[str, Callable[[], object]]:
    """Biharmonic weights on the surface for 10 handles."""
    import igl

    handles = _constraints(vertices)
    return {"bind": lambda: igl.harmonic(vertices, faces.astype(np.int64), handles, np.eye(len(handles)), 2)}


MESH_PEERS = {"potpourri3d heat": potpourri_heat, "libigl ARAP": igl_arap, "libigl biharmonic": igl_biharmonic}
