"""Compute biharmonic coordinates on tetrahedra, by a direct solve and by the small system of OptCtrlPoints.

Sources: Wang et al., "Linear Subspace Design for Real-Time Shape Deformation", 2015; Kim et al., "OptCtrlPoints", 2023.
Both methods factor the energy matrix, which libigl's Python bindings do not return. So this module assembles it.
"""

from collections.abc import Callable
from typing import Any

import igl
import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from bench.paper.peers.peer import Bind, Body, Deform, PeerError, Tetrahedra, on_nodes
from dfd.common.linear_algebra import Float64, Int64

Solve = Callable[[Int64], Float64]  # maps the distinct nodes (K,) of K handles to weights (N, K) at all nodes


def coordinates(body: Body) -> Bind:
    """Prepare weights of least biharmonic energy: 1 at a handle, 0 at all others. Weights reproduce affine maps."""
    return _binding(body, direct(body.within))


def opt_ctrl_points(body: Body) -> Bind:
    """Prepare the same weights as `coordinates`, but by `small_system`."""
    return _binding(body, small_system(body.within))


def _binding(body: Body, solve: Solve) -> Bind:
    def bind(held: Int64, group: Int64) -> Deform:
        nodes, first = on_nodes(body, held)
        weights = solve(nodes)

        def deform(targets: Float64) -> Float64:
            offsets = (targets - body.vertices[held])[first]
            return body.vertices + body.within.on_surface(weights @ offsets)

        return deform

    return bind


def direct(within: Tetrahedra) -> Solve:
    """Assemble the energy matrix. Return a solver that factors its rows and columns of all nodes except the handles."""
    nodes, energy = within.nodes, bilaplacian(within.nodes, within.cells)

    def solve(handles: Int64) -> Float64:
        size, components = np.ptp(nodes, axis=0).max(), igl.vertex_components(within.cells)
        for component in range(components.max() + 1):
            # Affine functions have energy 0, so weights are unique only if four handles do not lie in a plane.
            own = handles[components[handles] == component]
            if np.linalg.matrix_rank(np.c_[np.ones(len(own)), nodes[own] / size], tol=1e-3) < 4:
                on_each = f" on each of the {components.max() + 1} components" if components.max() else ""
                raise PeerError(f"needs four handles that do not lie in a plane{on_each}")
        free = np.setdiff1d(np.arange(len(nodes)), handles)
        weights = np.zeros((len(nodes), len(handles)))
        weights[handles, np.arange(len(handles))] = 1.0
        if len(free):
            weights[free] = -_factored(energy, free).solve(energy[free][:, handles].toarray())
        return weights

    return solve


def small_system(within: Tetrahedra) -> Solve:
    """Factor the energy matrix with four fixed nodes, which gives a generalized inverse G; return a solver.

    As in Kim et al., the weights of K handles are W = G S Λ + P C. S selects the handles, and P spans the affine
    functions, whose energy is 0. A dense system of K + 4 equations gives Λ and C. With fewer than four handles, the
    system has several solutions, and the solver uses the one of least norm.
    """
    nodes = within.nodes
    affine = np.c_[np.ones(len(nodes)), (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()]
    pins = qr(affine.T, mode="r", pivoting=True)[1][:4]  # four nodes that are far from coplanar
    free = np.setdiff1d(np.arange(len(nodes)), pins)
    factors = _factored(bilaplacian(nodes, within.cells), free)

    def solve(handles: Int64) -> Float64:
        count = len(handles)
        ones = np.zeros((len(nodes), count))
        ones[handles, np.arange(count)] = 1.0
        inverse = np.zeros_like(ones)  # columns of the generalized inverse
        inverse[free] = factors.solve(ones[free])
        scale = max(float(np.abs(inverse[handles]).max()), 1e-300)
        system = np.block([[inverse[handles] / scale, affine[handles]], [affine[handles].T, np.zeros((4, 4))]])
        solved = np.linalg.lstsq(system, np.eye(count + 4)[:, :count], rcond=1e-12)[0]
        return inverse @ (solved[:count] / scale) + affine @ solved[count:]

    return solve


def _factored(energy: csc_array, free: Int64) -> Any:
    try:
        return splu(energy[free][:, free].tocsc())
    except RuntimeError:
        raise PeerError("has a singular system, for example because the tetrahedra form several components") from None


def bilaplacian(nodes: Float64, cells: Int64) -> csc_array:
    """Return the squared Laplacian (N, N) without boundary conditions. Its null space contains the affine functions.

    The matrix is (L + B)ᵀ M⁻¹ (L + B) with lumped masses M. L integrates −∇φ·∇u over the volume. B integrates φ ∂u/∂n
    over the boundary triangles. For an affine u, L + B then gives 0 at every node.
    """
    positions = (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()  # unit size; this only scales the energy
    volumes = np.abs(igl.volume(positions, cells))
    if volumes.min() <= 0:
        raise PeerError("has tetrahedra without volume")
    facets, owner, apex = igl.boundary_facets(cells)
    gradient = csc_array(igl.grad(positions, cells))  # (3 T, N): the x rows of all tetrahedra, then y, then z
    slopes = csc_array((len(facets), len(nodes)))
    for rows in (owner + k * len(cells) for k in range(3)):
        # −3 × volume × gradient of the opposite node's hat function is the outward normal. Its length is the area.
        normal = -3 * volumes[owner] * gradient[rows, cells[owner, apex]]
        slopes += diags_array(normal) @ gradient[rows]
    thirds = (np.full(facets.size, 1 / 3), (facets.ravel(), np.repeat(np.arange(len(facets)), 3)))
    laplacian = igl.cotmatrix(positions, cells) + coo_array(thirds, shape=(len(nodes), len(facets))) @ slopes
    masses = np.bincount(cells.ravel(), np.repeat(volumes / 4, 4), minlength=len(nodes))
    return csc_array(laplacian.T @ diags_array(1.0 / masses) @ laplacian)
