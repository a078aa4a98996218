"""Fields fitted to features of another network at the vertices of a mesh, or at points around it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor, nn

from dfd.common import check
from dfd.common.linear_algebra import Float32
from dfd.distillation.targets import Targets
from dfd.geometry.topology import face_areas
from dfd.mesh.normalization import normalization

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh


class GivenFeatures(Targets):
    """Targets of a fit from given features.

    Features of vertices are blended with the barycentric coordinates of surface points drawn uniformly by area, as
    Eq. 2 blends positions; features of points are used at those points.

    Parameters
    ----------
    features
        (V, D), one row per vertex, or the pair points (N, 3) in mesh units and features (N, D). Rows are normalized.

    Raises ValueError if an array has another shape, is not finite, a row is zero, or (for vertices) no face has an
    area.
    """

    def __init__(self, mesh: Mesh, features: ArrayLike | tuple[ArrayLike, ArrayLike]) -> None:
        self.center, self.scale = normalization(mesh)
        positions = mesh.vertices
        self.kind: Literal["points", "vertices"] = "vertices"
        if isinstance(features, tuple | list) and len(features) == 2:  # no mesh has two vertices
            self.kind = "points"
            positions = check.array("distill", "points", features[0], ("N", 3), dtype=np.float64)
            self.features = check.array("distill", "features", features[1], ("N", "D"))
            if len(positions) == 0 or len(positions) != len(self.features):
                raise ValueError(
                    f"distill: `features` must have a row for each of the points, "
                    f"got {len(self.features)} rows for {len(positions)} points"
                )
        else:
            self.features = check.array("distill", "features", features, ("V", "D"))
            if len(self.features) != len(positions):
                remedy = "features of other points are given as (points, features)"
                if len(self.features) == len(mesh.faces):
                    remedy = "these may be those of its faces, which have as many: ask for those of vertices"
                raise ValueError(
                    f"distill: `features` must have shape ({len(positions)}, D), a row for each vertex of the mesh, "
                    f"got {self.features.shape}; {remedy}"
                )
        if self.dimension == 0:
            raise ValueError(f"distill: `features` must have at least one column, got {self.features.shape}")
        zero = np.flatnonzero(~self.features.any(axis=1))
        if len(zero):
            raise ValueError(f"distill: `features` must have rows with a direction, got only zeros in row {zero[0]}")
        self.points = ((positions - self.center) * self.scale).astype(np.float32)
        self._rows, self._positions = torch.from_numpy(self.features), torch.from_numpy(self.points)
        if self.kind == "vertices":
            self._faces = torch.tensor(mesh.faces)
            self._area = torch.from_numpy(np.cumsum(face_areas(self.points, mesh.faces)))
            if not float(self._area[-1]) > 0:
                raise ValueError("distill: `mesh` must have a face with an area: features are fitted on the surface")

    @property
    def dimension(self) -> int:
        """Width D of a row."""
        return int(self.features.shape[1])

    def rows(self, chosen: NDArray[np.integer]) -> Float32:
        """Unit features (B, D) of the chosen points or vertices."""
        return _unit(self._rows[torch.from_numpy(chosen)]).numpy()

    def draw(self, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Random points and their targets; on the faces if the features are those of vertices."""
        if self.kind == "points":
            return super().draw(count, generator)
        drawn = torch.rand(count, 3, generator=generator, dtype=torch.float64)
        # `right=True` never picks a face without area.
        face = torch.searchsorted(self._area, drawn[:, 0] * self._area[-1], right=True).clamp_(max=len(self._area) - 1)
        corners = self._faces[face].long()
        sqrt = drawn[:, 1].sqrt()
        shares = torch.stack([1 - sqrt, sqrt * (1 - drawn[:, 2]), sqrt * drawn[:, 2]], dim=1).float().unsqueeze(2)
        return (shares * self._positions[corners]).sum(dim=1), _unit((shares * _unit(self._rows[corners])).sum(dim=1))


def _unit(rows: Tensor) -> Tensor:
    """Rows at unit length without overflow; zero rows stay zero."""
    largest = rows.abs().amax(dim=-1, keepdim=True).clamp_min_(torch.finfo(torch.float32).tiny)
    return nn.functional.normalize(rows / largest, dim=-1)
