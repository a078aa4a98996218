"""Bounded biharmonic weights in tetrahedra; Jacobson et al., 2011. By libigl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.paper.peers.coordinates import on_nodes
from bench.paper.peers.peer import Body, check_pieces
from bench.quality.baselines import PeerError

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]


class Bounded:
    """Handles that move alike have one column; all weights are between 0 and 1, and sum to 1 with those that stay."""

    volume = True

    def prepare(self, body: Body) -> None:
        """Nothing belongs to the shape but its tetrahedra."""
        assert body.within is not None
        self.body, self.within = body, body.within

    def bind(self, held: Int64, group: Int64) -> None:
        """Solve the quadratic program of every group."""
        handles, first = on_nodes(self.body, held)
        check_pieces(self.within.cells, len(self.within.nodes), handles)
        self.held, self.groups = held, group
        columns = np.unique(group)
        ones = (group[first][:, None] == columns).astype(np.float64)
        self.columns, self.weights = columns, np.ones((len(self.within.nodes), 1))
        if len(columns) > 1:
            weights = bounded_weights(self.within.nodes, self.within.cells, handles, ones)
            self.weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)

    def deform(self, targets: Float64) -> Float64:
        """Blend the groups' mean offsets; those below 0 stay."""
        offsets = targets - self.body.vertices[self.held]
        means = np.array([offsets[self.groups == column].mean(axis=0) for column in self.columns])
        means[self.columns < 0] = 0.0
        return self.body.vertices + self.within.on_surface(self.weights @ means)


def bounded_weights(nodes: Float64, cells: Int64, known: Int64, values: Float64) -> Float64:
    """Weights (N, K) that have `values` (P, K) at the nodes `known` (P,).

    Raises PeerError if libigl is not installed, or finds no solution.
    """
    try:
        import igl
    except ImportError:
        raise PeerError("libigl is not installed") from None
    solved = np.asarray(igl.bbw(nodes, cells, known, np.ascontiguousarray(values)))
    if solved.shape != (len(nodes), values.shape[1]) or not np.isfinite(solved).all():
        raise PeerError("finds no solution")
    return solved
