"""A replacement of `dfd.Geodesics` that records its calls."""

import numpy as np


class Counting:
    """Return Euclidean distances, which are fast to compute, and record the handles of each call in `asked`."""

    def __init__(self, mesh):
        self.mesh, self.asked, self.extent = mesh, [], mesh.diagonal

    def lengths(self, handles):
        self.asked.append(list(handles))
        return np.linalg.norm(self.mesh.vertices[handles][:, None] - self.mesh.vertices, axis=2).astype(np.float32)

    def distances(self, handles):
        lengths = self.lengths(handles)
        return lengths / np.float32(self.extent)
