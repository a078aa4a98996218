"""The neural feature field: a small network that gives a unit feature for any point of space."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import safetensors.torch
import torch
from numpy.typing import ArrayLike, NDArray
from safetensors import SafetensorError, safe_open
from torch import nn

from dfd.common import check
from dfd.common.files import atomic_write
from dfd.common.torch_threads import share

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["Field"]

FORMAT = "dfd-field"
VERSION = 1
# Activations of one batch stay within half a megabyte, so that they live in a core's cache between two layers.
BATCH = 512
DEVICE_BATCH = 1 << 16  # a device with thousands of threads wants them all busy
MOST_OCTAVES = 16  # beyond, float32 no longer tells the angles apart


class Field(nn.Module):
    """Φ: points in a mesh's own units to unit feature rows.

    The network is the paper's (supplement L): hidden layers of `width` neurons, each a linear map, a ReLU and a
    LayerNorm, then a linear map to `dimension` numbers and division by their length. Points are first brought to
    (p − `center`) · `scale`, the normalisation of the mesh that the field was distilled from: it belongs to the
    field, never to the mesh. With `octaves` the network also sees sines and cosines of the coordinates, the longest
    two boxes long (Mildenhall et al. 2020, section 5.1): borders between parts are then fitted in far fewer steps.

    Parameters
    ----------
    dimension
        Width D of a feature row.
    width, layers
        Neurons of a hidden layer, and how many hidden layers.
    octaves
        How many wavelengths of sines and cosines the network is given, each half of the one before; 0 is the paper's.
    center
        (3,) in mesh units, the point that becomes the origin.
    scale
        Factor per mesh unit; with the longest side of the box s it is 2/s.
    settings
        How the field came to be (encoder, views, seed, …), kept with it in its file; JSON values.
    """

    center: torch.Tensor  # (3,) float64, mesh units
    scale: torch.Tensor  # () float64, per mesh unit

    def __init__(
        self,
        dimension: int,
        *,
        width: int = 256,
        layers: int = 4,
        octaves: int = 0,
        center: ArrayLike = (0.0, 0.0, 0.0),
        scale: float = 1.0,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.dimension = check.whole("Field", "dimension", dimension, minimum=1)
        self.width = check.whole("Field", "width", width, minimum=1)
        self.layers = check.whole("Field", "layers", layers, minimum=1)
        self.octaves = check.whole("Field", "octaves", octaves, minimum=0, maximum=MOST_OCTAVES)
        self.settings = dict(settings or {})
        self.register_buffer("center", torch.from_numpy(check.array("Field", "center", center, (3,), dtype=np.float64)))
        factor = check.number("Field", "scale", scale, minimum=0.0, exclusive=True)
        self.register_buffer("scale", torch.tensor(factor, dtype=torch.float64))
        entering = 3 + 6 * self.octaves
        hidden: list[nn.Module] = []
        for layer in range(self.layers):
            hidden += [nn.Linear(self.width if layer else entering, self.width), nn.ReLU(), nn.LayerNorm(self.width)]
        self.network = nn.Sequential(*hidden, nn.Linear(self.width, self.dimension))

    @classmethod
    def seeded(cls, seed: int, dimension: int, **how: Any) -> Field:
        """Return a field with the initial weights of `seed`; the caller's own random numbers stay as they were."""
        with torch.random.fork_rng(devices=()):
            torch.manual_seed(seed)
            return cls(dimension, **how)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Features of (N, 3) points in mesh units, (N, D) unit rows; differentiable in the points."""
        normalized = (points.to(self.center.dtype) - self.center) * self.scale
        return self.from_normalized(normalized.to(torch.float32))

    def from_normalized(self, points: torch.Tensor) -> torch.Tensor:
        """Features of (N, 3) float32 points that are normalised already."""
        waves = [points]
        for octave in range(self.octaves):
            angle = points * (math.pi / 2 * 2**octave)
            waves += [angle.sin(), angle.cos()]
        return nn.functional.normalize(self.network(torch.cat(waves, dim=-1)), dim=-1)

    @overload
    def __call__(self, points: torch.Tensor) -> torch.Tensor: ...
    @overload
    def __call__(self, points: ArrayLike) -> NDArray[np.float32]: ...
    def __call__(self, points: Any) -> Any:
        """Features of `points`.

        Parameters
        ----------
        points
            (N, 3) in mesh units, anywhere in space: an array, or a torch tensor.

        Returns
        -------
        (N, D) float32 unit rows, an array for an array (evaluated in batches, so that memory stays at the size of
        the result) and a tensor, with its gradient, for a tensor.

        Raises
        ------
        ValueError
            If `points` is not (N, 3) or, in an array, not finite.
        """
        if isinstance(points, torch.Tensor):
            if points.ndim != 2 or points.shape[1] != 3:
                raise ValueError(f"Field: `points` must have shape (N, 3), got {tuple(points.shape)}")
            return super().__call__(points)
        array = check.array("Field", "points", points, ("N", 3), dtype=np.float64)
        features = np.empty((len(array), self.dimension), np.float32)

        def fill(begin: int, end: int) -> None:
            batch = torch.tensor(array[begin:end]).to(self.center.device)
            features[begin:end] = self.forward(batch).cpu().numpy()

        if self.center.device.type == "cpu":
            share(len(array), BATCH, fill)
        else:
            with torch.inference_mode():
                for begin in range(0, len(array), DEVICE_BATCH):
                    fill(begin, min(begin + DEVICE_BATCH, len(array)))
        return features

    def features(self, mesh: Mesh) -> NDArray[np.float32]:
        """Features of every vertex of `mesh`, (V, D) float32 unit rows: what `dfd.bind` reads."""
        return self(mesh.vertices)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the field to `path` (.safetensors), whole or not at all.

        Raises
        ------
        OSError
            If `path` cannot be written; a file that was there stays as it was.
        """
        metadata = {
            "format": FORMAT,
            "version": str(VERSION),
            "network": json.dumps({name: getattr(self, name) for name in ("dimension", "width", "layers", "octaves")}),
            "settings": json.dumps(self.settings, sort_keys=True),
        }
        tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in self.state_dict().items()}
        with atomic_write(path) as temporary:
            temporary.write_bytes(_with_sorted_header(safetensors.torch.save(tensors, metadata)))

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, mesh: Mesh | None = None) -> Field:
        """Read a field from `path`: what `save` wrote, or a `.pth` of the method's public reference implementation.

        Parameters
        ----------
        mesh
            For a `.pth` the mesh that it was distilled from, whose normalisation the file does not hold; unused else.

        Raises
        ------
        OSError
            If `path` does not exist or cannot be read.
        ValueError
            If it is no field, cut short, of another version, or does not hold the tensors that it promises.
        """
        if not Path(path).is_file():
            raise FileNotFoundError(f"Field.load: `path` {os.fspath(path)} does not exist or is no file")
        if Path(path).suffix.lower() == ".pth":
            from dfd.field.reference_file import load_reference

            if mesh is None:
                raise ValueError(f"Field.load: `mesh` must be given for {os.fspath(path)}: it has the normalisation")
            return load_reference(path, mesh)
        try:
            with safe_open(path, framework="pt") as file:
                metadata = file.metadata() or {}
                _check_header(path, metadata)
                network = json.loads(metadata["network"])
                settings = json.loads(metadata["settings"])
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # no mapping
            with torch.device("meta"):  # which takes no memory, whatever the header says
                promised = cls(**network, settings=settings).state_dict()
        except SafetensorError as error:
            raise ValueError(f"Field.load: `path` {os.fspath(path)} is cut short or no field: {error}") from error
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"Field.load: `path` {os.fspath(path)} has an unreadable header: {error}") from error
        _check_tensors(path, promised, tensors)
        field = cls.seeded(0, **network, settings=settings)
        field.load_state_dict(tensors)
        return field.eval().requires_grad_(False)


def _with_sorted_header(content: bytes) -> bytes:
    """A safetensors file with its header in one order: safetensors writes metadata in another one every time."""
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + content[end:]


def _check_header(path: str | os.PathLike[str], metadata: Mapping[str, str]) -> None:
    if metadata.get("format") != FORMAT:
        raise ValueError(f"Field.load: `path` {os.fspath(path)} is a safetensors file but no field")
    if metadata.get("version") != str(VERSION):
        raise ValueError(
            f"Field.load: `path` {os.fspath(path)} has version {metadata.get('version')}, this dfd reads {VERSION}"
        )


def _check_tensors(
    path: str | os.PathLike[str], wanted: Mapping[str, torch.Tensor], found: Mapping[str, torch.Tensor]
) -> None:
    def shapes(tensors: Mapping[str, torch.Tensor], names: Sequence[str]) -> str:
        return ", ".join(f"{name} {tuple(tensors[name].shape)}" for name in names)

    odd = [name for name in wanted if name not in found or found[name].shape != wanted[name].shape]
    if odd:
        have = shapes(found, [name for name in odd if name in found]) or "nothing"
        raise ValueError(f"Field.load: `path` {os.fspath(path)} must hold {shapes(wanted, odd)}, found {have}")
    unknown = [name for name in found if name not in wanted]
    if unknown:
        raise ValueError(f"Field.load: `path` {os.fspath(path)} holds an unknown tensor {unknown[0]}")
    for name, tensor in found.items():
        if not torch.isfinite(tensor).all():
            raise ValueError(f"Field.load: `path` {os.fspath(path)} holds numbers that are not finite in {name}")
    if float(found["scale"]) <= 0:
        raise ValueError(f"Field.load: `path` {os.fspath(path)} has scale {float(found['scale'])}, not above 0")
