"""Biharmonic coordinates that are quick to bind anew; Kim et al., "OptCtrlPoints", 2023.

The energy is factored once. The weights of any K handles then follow from a system of K + 4 equations, as in their
paper's reformulation whose matrix depends on the number of control points rather than of vertices: W = G S Λ + P C,
where S picks the handles, G is a generalized inverse of the energy and P spans the affine functions, whose energy is 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from bench.paper.peers.coordinates import Coordinates
from bench.paper.peers.peer import Body
from bench.quality.baselines import PeerError

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]


class OptCtrlPoints(Coordinates):
    """The same weights as those of `Coordinates`; of fewer than four handles, the smallest of all that there are."""

    def prepare(self, body: Body) -> None:
        """Assemble the energy and factor it, four nodes held: that is the generalized inverse."""
        super().prepare(body)
        nodes = self.within.nodes
        places = (nodes - nodes.mean(axis=0)) / np.ptp(nodes, axis=0).max()
        self.affine = np.c_[np.ones(len(nodes)), places]
        pins = [int(places[:, 0].argmin())]
        for count in range(1, 4):  # each as far as can be from the point, line or plane of those before
            spanned = np.linalg.qr((places[pins[1:]] - places[pins[0]]).T)[0] if count > 1 else np.zeros((3, 1))
            offsets = places - places[pins[0]]
            pins.append(int(np.linalg.norm(offsets - offsets @ spanned @ spanned.T, axis=1).argmax()))
        self.free = np.setdiff1d(np.arange(len(nodes)), pins)
        try:
            self.factors = splu(self.energy[self.free][:, self.free].tocsc())
        except RuntimeError:
            raise PeerError("meets a singular system: the tetrahedra are not of one piece") from None

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
        weights: Float64 = inverse @ (solved[:count] / scale) + self.affine @ solved[count:]
        return weights
