"""Biharmonic coordinates in tetrahedra, by a direct solve and by OptCtrlPoints.

Wang et al., "Linear Subspace Design for Real-Time Shape Deformation", 2015; Kim et al., "OptCtrlPoints", 2023.
libigl for Python gives the coordinates but not the energy, which OptCtrlPoints factors.
"""

from __future__ import annotations

from typing import Any

import igl
import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from bench.paper.peers.peer import Body, PeerError
from bench.quality.measures import components_of
from dfd.common.linear_algebra import Float64, Int64


class Coordinates:
    """Weights of least biharmonic energy, 1 at their handle and 0 at the others; they reproduce affine maps."""

    volume = True

    def prepare(self, body: Body) -> None:
        """Assemble the energy."""
        self.body, self.within = body, body.within
        self.energy = bilaplacian(self.within.nodes, self.within.cells)

    def bind(self, held: Int64, group: Int64) -> None:
        """Solve for the weights of the nodes nearest to the handles."""
        handles, first = on_nodes(self.body, held)
        self.held, self.first = held, first
        self.weights = self.solve(handles)

    def solve(self, handles: Int64) -> Float64:
        """Return the weights (N, K) of distinct nodes (K,)."""
        nodes = self.within.nodes
        size = np.ptp(nodes, axis=0).max()
        components = components_of(self.within.cells, len(nodes))
        for component in range(components.max() + 1):
            # Affine functions have energy 0, so only four handles determine them.
            own = handles[components[handles] == component]
            if np.linalg.matrix_rank(np.c_[np.ones(len(own)), nodes[own] / size], tol=1e-3) < 4:
                on_each = f" on every one of the {components.max() + 1} components" if components.max() else ""
                raise PeerError(f"needs four handles that do not lie in a plane{on_each}")
        free = np.setdiff1d(np.arange(len(nodes)), handles)
        weights = np.zeros((len(nodes), len(handles)))
        weights[handles, np.arange(len(handles))] = 1.0
        if len(free):
            weights[free] = -factored(self.energy, free).solve(self.energy[free][:, handles].toarray())
        return weights

    def deform(self, targets: Float64) -> Float64:
        """Blend the handles' offsets."""
        offsets = (targets - self.body.vertices[self.held])[self.first]
        return self.body.vertices + self.within.on_surface(self.weights @ offsets)


class OptCtrlPoints(Coordinates):
    """The weights of `Coordinates`, and of fewer than four handles the smallest that solve their equations.

    The energy is factored once. K handles then take a system of K + 4 equations, as in the paper's reformulation:
    W = G S Λ + P C, where S picks the handles, G is a generalized inverse of the energy, and P spans the affine
    functions, whose energy is 0.
    """

    def prepare(self, body: Body) -> None:
        """Assemble the energy, and factor it with four nodes held, which gives the generalized inverse."""
        super().prepare(body)
        nodes = self.within.nodes
        self.affine = np.c_[np.ones(len(nodes)), (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()]
        pins = qr(self.affine.T, mode="r", pivoting=True)[1][:4]  # four nodes far from one plane
        self.free = np.setdiff1d(np.arange(len(nodes)), pins)
        self.factors = factored(self.energy, self.free)

    def solve(self, handles: Int64) -> Float64:
        """Return the weights (N, K) of distinct nodes (K,), by the small system."""
        count = len(handles)
        ones = np.zeros((len(self.affine), count))
        ones[handles, np.arange(count)] = 1.0
        inverse = np.zeros_like(ones)  # columns of the generalized inverse
        inverse[self.free] = self.factors.solve(ones[self.free])
        system = np.zeros((count + 4, count + 4))
        scale = max(float(np.abs(inverse[handles]).max()), 1e-300)
        system[:count, :count] = inverse[handles] / scale
        system[:count, count:] = self.affine[handles]
        system[count:, :count] = self.affine[handles].T
        solved = np.linalg.lstsq(system, np.eye(count + 4)[:, :count], rcond=1e-12)[0]
        return inverse @ (solved[:count] / scale) + self.affine @ solved[count:]


def factored(energy: csc_array, free: Int64) -> Any:
    """Return the factors of the energy (N, N) on the `free` nodes; raise PeerError if it is singular there."""
    try:
        return splu(energy[free][:, free].tocsc())
    except RuntimeError:
        raise PeerError("meets a singular system, as where tetrahedra have several components") from None


def on_nodes(body: Body, held: Int64) -> tuple[Int64, Int64]:
    """Return the distinct nodes (K,) nearest to vertices (N,), and the index (K,) of a vertex for each."""
    nodes, first = np.unique(body.within.nearest(body.vertices[held]), return_index=True)
    return nodes, first


def bilaplacian(nodes: Float64, cells: Int64) -> csc_array:
    """Return the squared Laplacian (N, N) whose null space is all affine functions, with no condition at the boundary.

    It is (L + N)ᵀ M⁻¹ (L + N). L integrates −∇φ·∇u over the volume. N adds ∂u/∂n over the triangles of the boundary, so
    that an affine u gives 0 at every node.
    """
    positions = (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()  # unit size only scales the energy
    volumes = np.abs(igl.volume(positions, cells))
    if volumes.min() <= 0:
        raise PeerError("has tetrahedra without volume")
    facets, owner, apex = igl.boundary_facets(cells)
    gradient = csc_array(igl.grad(positions, cells))  # (3 T, N), of all x, then y, then z
    slopes = csc_array((len(facets), len(nodes)))
    for rows in (owner + k * len(cells) for k in range(3)):
        # The outward normal, as long as the area, is −3 times the volume times the gradient of the opposite node.
        normal = -3 * volumes[owner] * gradient[rows, cells[owner, apex]]
        slopes += diags_array(normal) @ gradient[rows]
    thirds = (np.full(facets.size, 1 / 3), (facets.ravel(), np.repeat(np.arange(len(facets)), 3)))
    laplacian = igl.cotmatrix(positions, cells) + coo_array(thirds, shape=(len(nodes), len(facets))) @ slopes
    masses = np.bincount(cells.ravel(), np.repeat(volumes / 4, 4), minlength=len(nodes))
    return csc_array(laplacian.T @ diags_array(1.0 / masses) @ laplacian)
