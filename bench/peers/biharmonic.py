"""Compute biharmonic coordinates on tetrahedra, by a direct solve and by the small system of OptCtrlPoints.

Sources: Wang et al., "Linear Subspace Design for Real-Time Shape Deformation", 2015; Kim et al., "OptCtrlPoints", 2023.
Both methods factor the energy matrix, which libigl's Python bindings do not return. So this module assembles it.

In thin parts, all nodes lie on the boundary. There, Wang's energy is 0 also for functions that are not affine, so the
weights are not unique: on the chair, with four handles, they range from −43 to 21 and sum to −10.5 at a node. So
`energy` adds a small multiple of the squared jumps of the gradient between tetrahedra, which are 0 only for affine
functions. Where Wang's energy alone determines the weights, this changes them by 5e-4 on average.
"""

from collections.abc import Callable
from typing import Any

import igl
import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from bench.peers.peer import Bind, Body, Deform, PeerError, Tetrahedra, check_sums, on_nodes
from dfd.common.linear_algebra import Float64, Int64, unit

JUMPS = 1e-4  # factor of the jumps in the energy
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
        check_sums(weights)

        def deform(targets: Float64) -> Float64:
            offsets = (targets - body.vertices[held])[first]
            return body.vertices + body.within.on_surface(weights @ offsets)

        return deform

    return bind


def direct(within: Tetrahedra) -> Solve:
    """Assemble the energy matrix. Return a solver that factors its rows and columns of all nodes except the handles."""
    nodes, matrix = within.nodes, energy(within.nodes, within.cells)

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
            weights[free] = -_factored(matrix, free).solve(matrix[free][:, handles].toarray())
        return weights

    return solve


def small_system(within: Tetrahedra) -> Solve:
    """Factor the energy matrix with four fixed nodes, which gives a generalized inverse G; return a solver.

    As in Kim et al., the weights of K handles are W = G S Λ + P C. S selects the handles, and P spans the affine
    functions, whose energy is 0. A dense system of K + 4 equations gives Λ and C. With fewer than four handles, the
    system has several solutions, and the solver uses the one of least norm. P is centered at the handles, so that the
    weights of this solution sum to 1.
    """
    nodes = within.nodes
    affine = np.c_[np.ones(len(nodes)), (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()]
    pins = qr(affine.T, mode="r", pivoting=True)[1][:4]  # four nodes that are far from coplanar
    free = np.setdiff1d(np.arange(len(nodes)), pins)
    factors = _factored(energy(nodes, within.cells), free)

    def solve(handles: Int64) -> Float64:
        count = len(handles)
        ones = np.zeros((len(nodes), count))
        ones[handles, np.arange(count)] = 1.0
        inverse = np.zeros_like(ones)  # columns of the generalized inverse
        inverse[free] = factors.solve(ones[free])
        scale = max(float(np.abs(inverse[handles]).max()), 1e-300)
        span = np.c_[affine[:, 0], affine[:, 1:] - affine[handles, 1:].mean(axis=0)]
        system = np.block([[inverse[handles] / scale, span[handles]], [span[handles].T, np.zeros((4, 4))]])
        solved = np.linalg.lstsq(system, np.eye(count + 4)[:, :count], rcond=1e-12)[0]
        return inverse @ (solved[:count] / scale) + span @ solved[count:]

    return solve


def _factored(matrix: csc_array, free: Int64) -> Any:
    try:
        return splu(matrix[free][:, free].tocsc())
    except RuntimeError:
        raise PeerError("has a singular system, for example because the tetrahedra form several components") from None


def energy(nodes: Float64, cells: Int64) -> csc_array:
    """Return the energy matrix (N, N). If the tetrahedra are connected, its null space are the affine functions."""
    positions = (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()  # unit size; this only scales the energy
    volumes = np.abs(igl.volume(positions, cells))
    if volumes.min() <= 0:
        raise PeerError("has tetrahedra without volume")
    gradient = csc_array(igl.grad(positions, cells))  # (3 T, N): the x rows of all tetrahedra, then y, then z
    return csc_array(
        bilaplacian(positions, cells, volumes, gradient) + JUMPS * gradient_jumps(positions, cells, volumes, gradient)
    )


def bilaplacian(positions: Float64, cells: Int64, volumes: Float64, gradient: csc_array) -> csc_array:
    """Return the squared Laplacian (N, N) without boundary conditions. Its null space contains the affine functions.

    The matrix is (L + B)ᵀ M⁻¹ (L + B) with lumped masses M. L integrates −∇φ·∇u over the volume. B integrates φ ∂u/∂n
    over the boundary triangles. For an affine u, L + B then gives 0 at every node.
    """
    facets, owner, apex = igl.boundary_facets(cells)
    slopes = csc_array((len(facets), len(positions)))
    for rows in (owner + k * len(cells) for k in range(3)):
        # −3 × volume × gradient of the opposite node's hat function is the outward normal. Its length is the area.
        normal = -3 * volumes[owner] * gradient[rows, cells[owner, apex]]
        slopes += diags_array(normal) @ gradient[rows]
    thirds = (np.full(facets.size, 1 / 3), (facets.ravel(), np.repeat(np.arange(len(facets)), 3)))
    laplacian = igl.cotmatrix(positions, cells) + coo_array(thirds, shape=(len(positions), len(facets))) @ slopes
    masses = np.bincount(cells.ravel(), np.repeat(volumes / 4, 4), minlength=len(positions))
    return csc_array(laplacian.T @ diags_array(1.0 / masses) @ laplacian)


def gradient_jumps(positions: Float64, cells: Int64, volumes: Float64, gradient: csc_array) -> csc_array:
    """Return the matrix (N, N) of the sum of A / h · [∂u/∂n]² over all triangles between two tetrahedra.

    A is the area of a triangle, h the sum of both tetrahedra's heights above it, and [∂u/∂n] the difference of the
    derivatives of u along its normal. So the sum approximates an integral of squared second derivatives.
    """
    opposite = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
    triangles = np.sort(cells[:, opposite].reshape(-1, 3), axis=1)
    order = np.lexsort(triangles.T)
    shared = np.flatnonzero((triangles[order[1:]] == triangles[order[:-1]]).all(axis=1))
    first, second = order[shared] // 4, order[shared + 1] // 4  # the tetrahedra on both sides
    corners = positions[triangles[order[shared]]]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals, areas = unit(doubled), np.linalg.norm(doubled, axis=1) / 2
    heights = 3 * (volumes[first] + volumes[second]) / areas
    jumps = csc_array((len(shared), len(positions)))
    for axis, offset in enumerate(range(0, 3 * len(cells), len(cells))):
        jumps += diags_array(normals[:, axis]) @ (gradient[first + offset] - gradient[second + offset])
    return csc_array(jumps.T @ diags_array(areas / heights) @ jumps)
