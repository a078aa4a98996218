"""Prepare as-rigid-as-possible deformation (ARAP) and bounded biharmonic weights with libigl."""

import igl
import numpy as np

from bench.peers.peer import Bind, Body, Deform, PeerError, check_components, check_sums, on_nodes
from dfd.common.linear_algebra import Float64, Int64

ITERATIONS = 100  # largest number of iterations of ARAP


def arap(body: Body) -> Bind:
    """Prepare ARAP (Sorkine and Alexa, 2007), with a constraint for every held vertex."""

    def bind(held: Int64, group: Int64) -> Deform:
        check_components(body.faces, held)
        data = igl.ARAPData()
        data.max_iter = ITERATIONS
        igl.arap_precomputation(body.vertices, body.faces, 3, held.astype(np.int32), data)
        return lambda targets: np.asarray(igl.arap_solve(np.ascontiguousarray(targets), data, body.vertices))

    return bind


def bounded(body: Body) -> Bind:
    """Prepare bounded biharmonic weights on tetrahedra (Jacobson et al., 2011).

    Each group of held vertices has weights from 0 to 1. The fixed vertices form one group. Weights of a node sum to 1.
    """

    def bind(held: Int64, group: Int64) -> Deform:
        nodes, cells = body.within.nodes, body.within.cells
        handles, first = on_nodes(body, held)
        check_components(cells, handles)
        columns, weights = np.unique(group), np.ones((len(nodes), 1))
        if len(columns) > 1:
            ones = (group[first][:, None] == columns).astype(np.float64)
            weights = np.asarray(igl.bbw(nodes, cells, handles, ones))
            if weights.shape != (len(nodes), len(columns)) or not np.isfinite(weights).all():
                raise PeerError("finds no solution")
            weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
        check_sums(weights)

        def deform(targets: Float64) -> Float64:
            offsets = targets - body.vertices[held]
            means = np.array([offsets[group == column].mean(axis=0) for column in columns])
            return body.vertices + body.within.on_surface(weights @ means)

        return deform

    return bind
