"""Biharmonic coordinates in tetrahedra, by a direct solve and by OptCtrlPoints.

Wang et al., "Linear Subspace Design for Real-Time Shape Deformation", 2015; Kim et al., "OptCtrlPoints", 2023.
libigl for Python gives the coordinates but not the energy, which OptCtrlPoints factors.
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

Solve = Callable[[Int64], Float64]  # the weights (N, K) of distinct nodes (K,)


def coordinates(body: Body) -> Bind:
    """Prepare weights of least biharmonic energy, 1 at their handle and 0 at the others; they reproduce affine maps."""
    return _binding(body, direct(body.within))


def opt_ctrl_points(body: Body) -> Bind:
    """Prepare the weights of `coordinates` by `small_system`."""
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
    """Assemble the energy, which every solve factors without the handles."""
    nodes, energy = within.nodes, bilaplacian(within.nodes, within.cells)

    def solve(handles: Int64) -> Float64:
        size, components = np.ptp(nodes, axis=0).max(), igl.vertex_components(within.cells)
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
            weights[free] = -_factored(energy, free).solve(energy[free][:, handles].toarray())
        return weights

    return solve


def small_system(within: Tetrahedra) -> Solve:
    """Factor the energy once, with four nodes held, which gives a generalized inverse.

    K handles then take a system of K + 4 equations, as in the paper's reformulation: W = G S Λ + P C, where S picks the
    handles, G is the inverse, and P spans the affine functions, whose energy is 0. Fewer than four handles have the
    smallest weights that solve their equations.
    """
    nodes = within.nodes
    affine = np.c_[np.ones(len(nodes)), (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()]
    pins = qr(affine.T, mode="r", pivoting=True)[1][:4]  # four nodes far from one plane
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
        raise PeerError("meets a singular system, as where tetrahedra have several components") from None


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
