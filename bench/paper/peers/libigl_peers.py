"""ARAP and bounded biharmonic weights, by libigl."""

from __future__ import annotations

import igl
import numpy as np

from bench.paper.peers.biharmonic import on_nodes
from bench.paper.peers.peer import Body, PeerError, check_components
from dfd.common.linear_algebra import Float64, Int64

ITERATIONS = 100


class Arap:
    """As-rigid-as-possible surface modeling; Sorkine and Alexa, 2007. Every held vertex is a constraint."""

    volume = False

    def prepare(self, body: Body) -> None:
        """Keep the shape."""
        self.body = body

    def bind(self, held: Int64, group: Int64) -> None:
        """Factor the Laplacian without the held vertices."""
        check_components(self.body.faces, len(self.body.vertices), held)
        self.data = igl.ARAPData()
        self.data.max_iter = ITERATIONS
        igl.arap_precomputation(self.body.vertices, self.body.faces, 3, held.astype(np.int32), self.data)

    def deform(self, targets: Float64) -> Float64:
        """Alternate between rotations and positions."""
        return np.asarray(igl.arap_solve(np.ascontiguousarray(targets), self.data, self.body.vertices))


class Bounded:
    """Bounded biharmonic weights in tetrahedra; Jacobson et al., 2011.

    Handles that move alike have one column. All weights are between 0 and 1, and sum to 1 with those that stay.
    """

    volume = True

    def prepare(self, body: Body) -> None:
        """Keep the shape and its tetrahedra."""
        self.body, self.within = body, body.within

    def bind(self, held: Int64, group: Int64) -> None:
        """Solve the quadratic program of every group."""
        nodes, cells = self.within.nodes, self.within.cells
        handles, first = on_nodes(self.body, held)
        check_components(cells, len(nodes), handles)
        self.held, self.groups, self.columns = held, group, np.unique(group)
        self.weights = np.ones((len(nodes), 1))
        if len(self.columns) > 1:
            ones = (group[first][:, None] == self.columns).astype(np.float64)
            weights = np.asarray(igl.bbw(nodes, cells, handles, ones))
            if weights.shape != (len(nodes), len(self.columns)) or not np.isfinite(weights).all():
                raise PeerError("finds no solution")
            self.weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)

    def deform(self, targets: Float64) -> Float64:
        """Blend the groups' mean offsets; those below 0 stay."""
        offsets = targets - self.body.vertices[self.held]
        means = np.array([offsets[self.groups == column].mean(axis=0) for column in self.columns])
        means[self.columns < 0] = 0.0
        return self.body.vertices + self.within.on_surface(self.weights @ means)
