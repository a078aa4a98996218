"""Evaluate a neural feature field: a small network that gives a feature of unit length for any point of space."""

from __future__ import annotations

import copy
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

import dfd._core as _core
from dfd.common import check, tensors, threads
from dfd.common.errors import ArgumentError, called
from dfd.common.files import sha256_of_files
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.common.read_only import ReadOnlyArrays
from dfd.common.shown import Shown
from dfd.field import field_file
from dfd.field.architecture import Architecture
from dfd.field.compatibility import POINTS, check_compatible, surface_points
from dfd.field.component_residuals import ComponentResiduals, components_of_vertices

if TYPE_CHECKING:  # torch takes seconds to import, and only tensors need it
    import torch
    from scipy.spatial import cKDTree

    from dfd.mesh.mesh import Mesh

# Largest accepted magnitude of a normalized coordinate, (p − `center`) · `scale` for a point p. float32 cannot
# distinguish nearby points with larger coordinates.
FARTHEST = 1e6
RESIDUALS = "residuals."  # prefix, in field files, of the names of the arrays of `ComponentResiduals`


@dataclass(frozen=True)
class FieldSource:
    """The path of a field's file, and the SHA-256 of its content, 64 hexadecimal digits."""

    path: Path
    sha256: str

    @classmethod
    def of(cls, path: str | os.PathLike[str]) -> FieldSource:
        """Return the source for `path`, with the hash of the file's present content."""
        return cls(Path(path), sha256_of_files(Path(path)))


class Field(Shown, ReadOnlyArrays):
    """The map Φ of the paper, from points in mesh units to features, which are vectors of unit length.

    The network is that of the paper (supplement L). Each hidden layer is a linear map, a ReLU and a LayerNorm. A last
    linear map gives a vector of D numbers, which is divided by its length. A point p is first normalized to
    (p − `center`) · `scale`. `center` and `scale` come from the distilled mesh, and are valid for all its resolutions.

    If `octaves` is above 0, a positional encoding adds inputs to the network: sines and cosines of the coordinates. The
    longest wavelength is twice the longest side of the bounding box (Mildenhall et al. 2020, section 5.1). With this
    encoding, the fit needs far fewer steps to reproduce borders between parts.

    With `residuals`, the feature of a mesh's vertex also depends on the vertex's connected component: see
    `dfd.field.component_residuals`.

    A field is immutable. A C++ kernel evaluates arrays of points, without torch or a GPU. `source` is the file from
    which the field was read, or None.

    Parameters
    ----------
    parameters
        Arrays by their names in `dfd.field.architecture`: weight and bias of each linear map and each LayerNorm.
    octaves
        The number of wavelengths of the sines and cosines. Each wavelength is half of the previous one; 0 in the paper.
    center
        The center (3,) of the shape's bounding box, in mesh units. The normalization maps it to the origin.
    scale
        2 divided by the longest side of the bounding box, in mesh units.
    settings
        Settings of the distillation (encoder, views, seed, …) as JSON values; they are saved in the file.
    residuals
        Corrections of the network's features at surface samples of each connected component; or None.
    surface
        (512, 3) surface samples of the distilled shape in mesh units. `dfd.field.compatibility.check_compatible`
        compares them with samples of a mesh. If `surface` is None, only the bounding boxes are compared.

    Raises
    ------
    ValueError
        If a parameter is missing or unknown, has the wrong array shape or is not finite. If another argument is out of
        its range. If `residuals` have another dimension than the features.
    """

    _without_network: ClassVar[type[Field]]  # the class of fields without a network, which `dfd.field` sets
    source: FieldSource | None = None
    residuals: ComponentResiduals | None = None
    surface: Float32 | None = None

    def __init__(
        self,
        parameters: Mapping[str, ArrayLike],
        *,
        octaves: int = 0,
        center: ArrayLike = (0.0, 0.0, 0.0),
        scale: float = 1.0,
        settings: Mapping[str, Any] | None = None,
        residuals: ComponentResiduals | None = None,
        surface: ArrayLike | None = None,
    ) -> None:
        self.architecture = Architecture.of(parameters, octaves)
        self.parameters = {name: _frozen(name, parameters[name]) for name in self.architecture.shapes()}
        self.center = _frozen("center", center, (3,), np.float64)
        self.scale = check.number("Field", "scale", scale, minimum=0.0, exclusive=True)
        self.settings = dict(settings or {})
        self.residuals = self._checked_residuals(residuals)
        self.surface = None if surface is None else _frozen("surface", surface, (POINTS, 3))

    @property
    def dimension(self) -> int:
        """Return the dimension D of a feature."""
        return self.architecture.dimension

    @property
    def samples(self) -> Float64 | None:
        """Return points (N, 3) of the distilled surface, mesh units; None if unknown."""
        return None if self.surface is None else self.surface.astype(np.float64)

    def __repr__(self) -> str:
        encoder = self.settings.get("encoder")
        return f"Field({self.dimension} dimensions{f' of {encoder}' if encoder else ''})"

    @overload
    def __call__(self, points: torch.Tensor) -> torch.Tensor: ...
    @overload
    def __call__(self, points: ArrayLike) -> Float32: ...
    def __call__(self, points: Any) -> Any:
        """Return the features of `points`.

        Raises ValueError if `points` is not (N, 3). Raises ValueError if a point in an array is not finite, or if a
        coordinate of (p − `center`) · `scale` has a magnitude above a million.

        Parameters
        ----------
        points
            (N, 3) in mesh units, anywhere in space: an array, or a torch tensor.

        Returns
        -------
        (N, D) float32 rows of unit length: a differentiable tensor if `points` is a tensor, otherwise an array.
        """
        if tensors.is_tensor(points):
            return self._of_tensor(points)
        array = self._checked_points(points)
        features: Float32 = _core.empty_float32(len(array), self.dimension)
        self._kernel.evaluate(array, features, threads.get_num_threads())
        return features

    def _checked_points(self, points: Any) -> Float64:
        array = check.array("Field", "points", points, ("N", 3), dtype=np.float64)
        with np.errstate(over="ignore"):
            farthest = float(np.abs((array - self.center) * self.scale).max(initial=0.0))
        if not farthest <= FARTHEST:
            reason = f"must have coordinates within {FARTHEST:g} half sides of the box's center, got {farthest:.3g}"
            raise ArgumentError("points", reason, "Field")
        return array

    def with_settings(self, settings: Mapping[str, Any]) -> Field:
        """Return a copy of the field with these `settings`."""
        other = copy.copy(self)
        other.settings = dict(settings)
        other.source = None
        return other

    def with_surface(self, mesh: Mesh) -> Field:
        """Return a copy of the field with surface samples of `mesh`, which serve to detect meshes of another shape."""
        other = self.with_settings(self.settings)
        other.surface = surface_points(mesh)
        return other

    def with_residuals(self, residuals: ComponentResiduals | None) -> Field:
        """Return a copy of the field with these `residuals`, or with none; ValueError if their dimension is not D."""
        other = self.with_settings(self.settings)
        other.residuals = self._checked_residuals(residuals)
        return other

    def _checked_residuals(self, residuals: ComponentResiduals | None) -> ComponentResiduals | None:
        if residuals is not None and residuals.dimension != self.dimension:
            raise ArgumentError("residuals", f"must be {self.dimension} wide, got {residuals.dimension}", "Field")
        return residuals

    def on(self, mesh: Mesh) -> FieldOnMesh:
        """Return an object that gives the features of chosen vertices of `mesh`, and of points on the mesh."""
        return FieldOnMesh(self, mesh)

    def features(self, mesh: Mesh) -> Float32:
        """Return the features of all vertices of `mesh` for `dfd.bind`, (V, D) float32 rows of unit length."""
        return self.on(mesh).rows(slice(None))

    def _of_tensor(self, points: torch.Tensor) -> torch.Tensor:
        import torch

        from dfd.field.network import Network

        if points.layout != torch.strided or points.dtype.is_complex or points.is_meta:
            found = f"{points.layout}, {points.dtype} on {points.device}"
            raise ArgumentError("points", f"must be a dense tensor of real numbers, got {found}", "Field")
        if points.ndim != 2 or points.shape[1] != 3:
            raise ArgumentError("points", f"must have shape (N, 3), got {tuple(points.shape)}", "Field")
        network = Network.of(self.parameters, self.architecture).to(points.device)
        center = torch.tensor(self.center, device=points.device)
        return network(((points.to(center.dtype) - center) * self.scale).to(torch.float32))

    @cached_property
    def _kernel(self) -> _core.Field:
        arrays = list(self.parameters.values())
        return _core.Field(
            weights=arrays[::4],
            biases=arrays[1::4],
            gains=arrays[2::4],
            shifts=arrays[3::4],
            octaves=self.architecture.octaves,
            center=self.center.tolist(),
            scale=self.scale,
        )

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_kernel"}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the field to `path` (.safetensors) atomically; equal fields give equal bytes.

        Raises OSError if `path` cannot be written; an existing file stays unchanged.
        """
        arrays = {**self.parameters, "center": self.center, "scale": np.array(self.scale)}
        if self.surface is not None:
            arrays["surface"] = self.surface
        if self.residuals is not None:
            arrays |= {f"{RESIDUALS}{name}": array for name, array in self.residuals.arrays().items()}
        field_file.write(path, self.architecture, arrays, self.settings)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, mesh: Mesh | None = None, other_shape: bool = False) -> Field:
        """Return the field in a file that `save` wrote.

        Parameters
        ----------
        path
            The file.
        mesh
            The mesh to which the field must belong (`dfd.field.compatibility.check_compatible`); None skips the check.
        other_shape
            Whether to accept a field of another shape.

        Raises
        ------
        OSError
            If `path` does not exist or cannot be read.
        ValueError
            If the file is not a field, is truncated, has another version, lacks arrays of the network, or gives
            features that are not finite. If the field was distilled from another shape than `mesh`.
        """
        if not Path(path).is_file():
            raise FileNotFoundError(f"Field.load: `path` {os.fspath(path)} does not exist or is not a file")
        architecture, arrays, settings = field_file.read(path)
        try:
            owner = Field._without_network if architecture is None else Field
            field = owner._of_arrays(arrays, settings, architecture)
        except (ArgumentError, TypeError) as error:
            reason = f"`{error.argument}` {error.reason}" if isinstance(error, ArgumentError) else str(error)
            raise ArgumentError("path", f"{os.fspath(path)} is damaged: {reason}", "Field.load") from error
        if mesh is not None and not other_shape:
            with called("Field.load"), warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # a `Deformer` with the field gives the same warning
                check_compatible(field, mesh, allowed_by="other_shape=True")
        field.source = FieldSource.of(path)
        return field

    @classmethod
    def _of_arrays(
        cls, arrays: dict[str, NDArray[Any]], settings: Mapping[str, Any], architecture: Architecture | None
    ) -> Field:
        """Return the field with the contents of a file. Raises ArgumentError or TypeError if they are damaged."""
        assert architecture is not None, "only a `VertexField` has no network"
        stored = [name for name in arrays if name.startswith(RESIDUALS)]
        residuals = {name.removeprefix(RESIDUALS): arrays.pop(name) for name in stored}
        others: dict[str, Any] = {"center": (), "scale": (), "surface": None}
        others = {name: arrays.pop(name, missing) for name, missing in others.items()}
        checked = ComponentResiduals(**residuals) if residuals else None
        field = Field(arrays, octaves=architecture.octaves, settings=settings, residuals=checked, **others)
        if field.architecture != architecture:
            raise ArgumentError("parameters", f"must be those of {architecture}, got {field.architecture}")
        corners = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        if not np.isfinite(field(field.center + corners / field.scale)).all():
            raise TypeError("its features are not finite")
        return field


class FieldOnMesh:
    """The features of a mesh's vertices and of points on the mesh, including the residuals of connected components."""

    def __init__(self, field: Field, mesh: Mesh) -> None:
        self.field, self.mesh = field, mesh

    @property
    def shape(self) -> tuple[int, int]:
        """Return the number of vertices V and the dimension D of a feature."""
        return len(self.mesh.vertices), self.field.dimension

    def rows(self, vertices: slice | NDArray[np.integer[Any]]) -> Float32:
        """Return the features of the vertices with the indices `vertices`, (N, D) float32 rows of unit length."""
        points = self.mesh.vertices[vertices]
        return self._of(points, None if self._component is None else self._component[vertices])

    def at(self, points: NDArray[np.floating[Any]]) -> Float32:
        """Return the features (N, D) at `points` (N, 3) in mesh units; the nearest vertex gives a point's component."""
        places = np.asarray(points, np.float64)
        return self._of(places, None if self._component is None else self._component[self._nearest.query(places)[1]])

    def _of(self, points: Float64, component: Int64 | None) -> Float32:
        field = self.field
        rows = field(points)
        if component is None or field.residuals is None:
            return rows
        return field.residuals.add_residuals(rows, (points - field.center) * field.scale, component)

    @cached_property
    def _component(self) -> Int64 | None:
        """Return the index (V,) of each vertex's component in the residuals, or −1; without residuals, return None."""
        if self.field.residuals is None:
            return None
        component, boxes = components_of_vertices(self.mesh)
        corners = (boxes.reshape(-1, 2, 3) - self.field.center) * self.field.scale
        known = np.append(self.field.residuals.known(corners.reshape(-1, 6)), -1)  # component −1 stays −1
        return known[component]

    @cached_property
    def _nearest(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self.mesh.vertices)


def _frozen(name: str, values: ArrayLike, shape: Any = None, dtype: Any = np.float32) -> NDArray[Any]:
    """Return a read-only copy of `values`; ValueError if its array shape is wrong or a number is not finite."""
    array = check.array("Field", name, values, np.shape(values) if shape is None else shape, dtype=dtype).copy()
    array.flags.writeable = False
    return array
