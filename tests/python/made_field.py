"""Make fields with random network weights, and features of samples, which need no distillation."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd import Field, Mesh
from dfd.field.architecture import Architecture
from dfd.samples import Sample


def same(first: Field, second: Field) -> bool:
    """Return whether two fields have equal bits and equal settings."""
    arrays = [{**field.parameters, "center": field.center} for field in (first, second)]
    equal = arrays[0].keys() == arrays[1].keys() and all(
        np.array_equal(values, arrays[1][name]) for name, values in arrays[0].items()
    )
    return equal and (first.scale, first.settings) == (second.scale, second.settings)


def made_field(
    dimension: int, *, width: int = 256, layers: int = 4, octaves: int = 0, seed: int = 0, **how: Any
) -> Field:
    """Return a field with random weights, initialized like torch's; `how` are further arguments of `Field`."""
    generator = np.random.default_rng(seed)
    parameters = {}
    fan_in = 1
    for name, shape in Architecture(dimension, width, layers, octaves).shapes().items():
        fan_in = shape[1] if len(shape) == 2 else fan_in
        norm = int(name.split(".")[1]) % 3 == 2
        drawn = generator.uniform(-1, 1, shape) / np.sqrt(fan_in)
        parameters[name] = (np.full(shape, float(name.endswith("weight"))) if norm else drawn).astype(np.float32)
    return Field(parameters, octaves=octaves, **how)


def field_of(mesh: Mesh, seed: int = 0, **how: Any) -> Field:
    """Return a field with random weights for the box of `mesh`."""
    how = {"center": mesh.bounds.mean(0), "scale": 2 / max(float(mesh.extents.max()), 1e-30)} | how
    return made_field(16, seed=seed, width=32, layers=2, **how)


def looks(sample: Sample, noise: float = 0.1) -> NDArray[np.float32]:
    """Return features (V, 16) that tell the parts of a sample apart, with noise."""
    random = np.random.default_rng(0)
    rows = random.normal(size=(len(sample.parts), 16))[sample.labels]
    rows += noise * random.normal(size=rows.shape)
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)
