"""Fields of features that another network has given to the vertices of a mesh, or to points around it."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor, nn

from dfd.common import check
from dfd.common.devices import choose_device
from dfd.common.progress import Stages
from dfd.distillation.fit import descend
from dfd.field.field import Field
from dfd.geometry.topology import face_areas
from dfd.mesh.normalization import normalization
from dfd.runs.recipe import recipe, summed
from dfd.runs.run import Run

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["GivenFeatures", "fit_features"]

_ROWS_AT_ONCE = 1 << 16  # to bound memory


def fit_features(
    mesh: Mesh,
    features: ArrayLike | tuple[ArrayLike, ArrayLike],
    settings: dict[str, Any],
    *,
    device: str | None,
    stages: Stages,
    cache: bool,
    checkpoint: str | PathLike[str] | None,
) -> Field:
    """Do what `dfd.distill` does when it is given `features`; `settings` are those of the fit, checked."""
    target = choose_device("distill", device)
    center, scale = normalization(mesh)
    given = GivenFeatures(mesh, features, center=center, scale=scale)
    settings = {**settings, "features": "points" if given.at_points else "vertices"}
    content = summed(given.points, given.features)
    run = Run(recipe(mesh, **settings, given=content, device=str(target)), cache, checkpoint)
    found = run.found()
    if found is not None:
        return found
    run.begin()
    generator = torch.Generator().manual_seed(settings["seed"])

    def draw() -> tuple[Tensor, Tensor]:
        points, targets = given.draw(settings["batch"], generator)
        return points.to(target), targets.to(target)

    with run.step("the fit", "lower `batch`, or give features with fewer columns"):
        field = Field.seeded(
            settings["seed"], given.dimension, octaves=settings["octaves"], center=center, scale=scale
        ).to(target)
        losses = descend(
            field,
            draw,
            steps=settings["steps"],
            learning_rate=settings["learning_rate"],
            generator=generator,
            stages=stages,
            state=run.fit_state(),
        )
    field.settings = {**settings, "losses": losses}
    return run.finish(field)


class GivenFeatures:
    """Targets of a fit from features that are given.

    Features of the vertices are blended with the barycentric coordinates of surface points that are drawn evenly by
    area, as Eq. 2 blends positions; features of points are taken where they are.

    Parameters
    ----------
    features
        (V, D), a row a vertex, or the pair points (N, 3) in mesh units and their rows (N, D). Rows need not be of unit
        length; only their directions count.
    center, scale
        The normalisation of the field: (p − `center`) · `scale`.

    Raises
    ------
    ValueError
        If an array has another shape, is not finite, a row is zero, or (for vertices) no face has an area.
    """

    def __init__(
        self,
        mesh: Mesh,
        features: ArrayLike | tuple[ArrayLike, ArrayLike],
        *,
        center: NDArray[np.float64],
        scale: float,
    ) -> None:
        self.at_points = isinstance(features, tuple | list) and len(features) == 2  # no mesh has two vertices
        if isinstance(features, tuple | list) and len(features) == 2:
            positions, rows = features
            places = check.array("distill", "points", positions, ("N", 3), dtype=np.float64)
            self.features = check.array("distill", "features", rows, ("N", "D"))
            if len(places) == 0 or len(places) != len(self.features):
                raise ValueError(
                    f"distill: `features` must have a row for each of the points, "
                    f"got {len(self.features)} rows for {len(places)} points"
                )
        else:
            places = mesh.vertices
            self.features = check.array("distill", "features", features, ("V", "D"))
            if len(self.features) != len(places):
                raise ValueError(
                    f"distill: `features` must have shape ({len(places)}, D), a row for each distinct vertex of the "
                    f"mesh, got {self.features.shape}; features of other points are given as (points, features)"
                )
        if self.features.shape[1] == 0:
            raise ValueError(f"distill: `features` must have at least one column, got {self.features.shape}")
        for start in range(0, len(self.features), _ROWS_AT_ONCE):
            zero = ~self.features[start : start + _ROWS_AT_ONCE].any(axis=1)
            if zero.any():
                row = start + int(zero.argmax())
                raise ValueError(f"distill: `features` must have rows with a direction, got only zeros in row {row}")
        self.points = ((places - center) * scale).astype(np.float32)
        self._rows, self._places = torch.from_numpy(self.features), torch.from_numpy(self.points)
        if not self.at_points:
            self._faces = torch.tensor(mesh.faces)
            self._area = torch.from_numpy(np.cumsum(face_areas(self.points, mesh.faces)))
            if not float(self._area[-1]) > 0:
                raise ValueError("distill: `mesh` must have a face with an area: features are fitted on the surface")

    @property
    def dimension(self) -> int:
        """Width D of a row."""
        return int(self.features.shape[1])

    def draw(self, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Return `count` points (count, 3), normalised, and their unit targets (count, D), on the CPU."""
        if self.at_points:
            chosen = torch.randint(len(self._rows), (count,), generator=generator)
            return self._places[chosen], _unit(self._rows[chosen])
        drawn = torch.rand(count, 3, generator=generator, dtype=torch.float64)
        # The first face whose end lies beyond: one without area is never it.
        face = torch.searchsorted(self._area, drawn[:, 0] * self._area[-1], right=True).clamp_(max=len(self._area) - 1)
        corners = self._faces[face].long()
        root = drawn[:, 1].sqrt()
        shares = torch.stack([1 - root, root * (1 - drawn[:, 2]), root * drawn[:, 2]], dim=1).float().unsqueeze(2)
        return (shares * self._places[corners]).sum(dim=1), _unit((shares * _unit(self._rows[corners])).sum(dim=1))


def _unit(rows: Tensor) -> Tensor:
    """Rows at unit length, whatever their length was; zero where they cancelled out."""
    largest = rows.abs().amax(dim=-1, keepdim=True).clamp_min_(torch.finfo(torch.float32).tiny)
    return nn.functional.normalize(rows / largest, dim=-1)
