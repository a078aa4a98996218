"""As-rigid-as-possible surface modeling; Sorkine and Alexa, 2007. By libigl."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.paper.peers.peer import Body, check_pieces
from bench.quality.baselines import PeerError

ITERATIONS = 100


class Arap:
    """Every held vertex is a constraint; from the resting shape."""

    volume = False

    def prepare(self, body: Body) -> None:
        """Nothing belongs to the shape alone."""
        self.body = body

    def bind(self, held: NDArray[np.int64], group: NDArray[np.int64]) -> None:
        """Factor the Laplacian without the held vertices."""
        try:
            import igl
        except ImportError:
            raise PeerError("libigl is not installed") from None
        check_pieces(self.body.faces, len(self.body.vertices), held)
        self.data = igl.ARAPData()
        self.data.max_iter = ITERATIONS
        igl.arap_precomputation(self.body.vertices, self.body.faces, 3, held.astype(np.int32), self.data)

    def deform(self, targets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Alternate between rotations and positions."""
        import igl

        return np.asarray(igl.arap_solve(np.ascontiguousarray(targets), self.data, self.body.vertices))
