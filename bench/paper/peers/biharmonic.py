"""Biharmonic coordinates in tetrahedra, and the same that are quick to bind anew.

Wang et al., "Linear Subspace Design for Real-Time Shape Deformation", 2015; Kim et al., "OptCtrlPoints", 2023.

Checked in tests/python/bench/test_paper.py: both interpolate their control points and reproduce affine maps, as the
first paper proves of its coordinates; the second has the weights of the first's direct solve.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from bench.paper.peers.peer import Body, PeerError, libigl
from bench.quality.measures import components_of
from dfd.common.linear_algebra import Float64, Int64


class Coordinates:
    """Weights W of least biharmonic energy that are 1 at their handle and 0 at the others; they are affinely exact."""

    volume = True

    def prepare(self, body: Body) -> None:
        """Assemble the energy."""
        self.body, self.within = body, body.within
        self.energy = bilaplacian(self.within.nodes, self.within.cells)

    def bind(self, held: Int64, group: Int64) -> None:
        """Factor the energy without the handles, and solve for their weights."""
        handles, self.first = on_nodes(self.body, held)
        self.held = held
        self.weights = self.solve(handles)

    def solve(self, handles: Int64) -> Float64:
        """Weights (N, K) of distinct nodes (K,)."""
        nodes = self.within.nodes
        size = np.ptp(nodes, axis=0).max()
        components = components_of(self.within.cells, len(nodes))
        for component in range(components.max() + 1):
            # Affine functions cost nothing: fewer than four handles leave them open there.
            own = handles[components[handles] == component]
            if np.linalg.matrix_rank(np.c_[np.ones(len(own)), nodes[own] / size], tol=1e-3) < 4:
                on_each = f" on every one of the {components.max() + 1} components" if components.max() else ""
                raise PeerError(f"needs four handles that do not lie in a plane{on_each}")
        free = np.setdiff1d(np.arange(len(nodes)), handles)
        weights = np.zeros((len(nodes), len(handles)))
        weights[handles, np.arange(len(handles))] = 1.0
        if len(free):
            rest = self.energy[:, free].tocsc()
            try:
                weights[free] = -splu(rest[free]).solve(self.energy[free][:, handles].toarray())
            except RuntimeError:
                raise PeerError("meets a singular system") from None
        return weights

    def deform(self, targets: Float64) -> Float64:
        """Blend the handles' offsets."""
        offsets = (targets - self.body.vertices[self.held])[self.first]
        return self.body.vertices + self.within.on_surface(self.weights @ offsets)


class OptCtrlPoints(Coordinates):
    """The same weights as those of `Coordinates`; of fewer than four handles, the smallest of all that there are.

    The energy is factored once. The weights of any K handles then follow from a system of K + 4 equations, as in the
    paper's reformulation whose matrix depends on the number of control points rather than of vertices:
    W = G S Λ + P C, where S picks the handles, G is a generalized inverse of the energy and P spans the affine
    functions, whose energy is 0.
    """

    def prepare(self, body: Body) -> None:
        """Assemble the energy and factor it, four nodes held: that is the generalized inverse."""
        super().prepare(body)
        nodes = self.within.nodes
        positions = (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()
        self.affine = np.c_[np.ones(len(nodes)), positions]
        pins = [int(positions[:, 0].argmin())]
        for count in range(1, 4):  # each as far as can be from the point, line or plane of those before
            spanned = np.linalg.qr((positions[pins[1:]] - positions[pins[0]]).T)[0] if count > 1 else np.zeros((3, 1))
            offsets = positions - positions[pins[0]]
            pins.append(int(np.linalg.norm(offsets - offsets @ spanned @ spanned.T, axis=1).argmax()))
        self.free = np.setdiff1d(np.arange(len(nodes)), pins)
        try:
            self.factors = splu(self.energy[self.free][:, self.free].tocsc())
        except RuntimeError:
            raise PeerError("meets a singular system: the tetrahedra are not of one component") from None

    def solve(self, handles: Int64) -> Float64:
        """Weights (N, K) of distinct nodes (K,), by the small system."""
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


def on_nodes(body: Body, held: Int64) -> tuple[Int64, Int64]:
    """The distinct nodes (K,) nearest to vertices (N,), and which of those each node stands for."""
    nodes, first = np.unique(body.within.nearest(body.vertices[held]), return_index=True)
    return nodes, first


def bilaplacian(nodes: Float64, cells: Int64) -> csc_array:
    """(N, N) the squared Laplacian whose null space is all affine functions: no condition is set at the boundary.

    (L + N)ᵀ M⁻¹ (L + N), where L integrates −∇φ·∇u over the volume and N adds ∂u/∂n over the boundary's triangles, so
    that an affine u gives 0 at every node. Nodes are taken at unit size, which scales the energy alone.
    """
    igl = libigl()
    positions = (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()
    at = positions[cells]
    volumes = np.abs(np.linalg.det(at[:, 1:] - at[:, :1])) / 6
    if volumes.min() <= 0:
        raise PeerError("has tetrahedra without volume")
    facets, owner, _ = map(np.asarray, igl.boundary_facets(cells))
    corners = positions[facets]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2  # as long as the area
    inwards = np.einsum("bd,bd->b", normals, corners.mean(axis=1) - at[owner].mean(axis=1)) < 0
    normals[inwards] *= -1
    gradient = csc_array(igl.grad(positions, cells))  # (3 T, N), of all x, then y, then z
    slopes = sum(diags_array(normals[:, k]) @ gradient[owner + k * len(cells)] for k in range(3))
    thirds = (np.full(facets.size, 1 / 3), (facets.ravel(), np.repeat(np.arange(len(facets)), 3)))
    laplacian = igl.cotmatrix(positions, cells) + coo_array(thirds, shape=(len(nodes), len(facets))) @ slopes
    masses = np.bincount(cells.ravel(), np.repeat(volumes / 4, 4), minlength=len(nodes))
    return csc_array(laplacian.T @ diags_array(1.0 / masses) @ laplacian)
