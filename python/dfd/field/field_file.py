"""Field files: safetensors, with the architecture and the settings in the metadata."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Float32, Float64
from dfd.field.architecture import Architecture
from dfd.field.compatibility import POINTS

FORMAT = "dfd-field"
VERSION = 1
RESIDUALS = {name: f"residuals.{name}" for name in ("boxes", "points", "component", "differences")}


@dataclass(frozen=True, eq=False)
class Content:
    """What a field is made of."""

    architecture: Architecture
    parameters: Mapping[str, Float32]
    center: Float64  # (3,) mesh units
    scale: float  # per mesh unit
    settings: dict[str, Any]
    residuals: Mapping[str, NDArray[Any]] | None = None  # see `dfd.field.component_residuals`
    surface: Float32 | None = None  # (P, 3) points of the shape, mesh units


def write(path: str | os.PathLike[str], content: Content) -> None:
    """Write a field, whole or not at all; raises what `Field.save` raises."""
    metadata = {
        "format": FORMAT,
        "version": str(VERSION),
        "network": json.dumps(asdict(content.architecture)),
        "settings": json.dumps(content.settings, sort_keys=True),
    }
    arrays: dict[str, NDArray[Any]] = {**content.parameters, "center": content.center, "scale": np.array(content.scale)}
    if content.surface is not None:
        arrays["surface"] = content.surface
    arrays |= {RESIDUALS[name]: array for name, array in (content.residuals or {}).items()}
    with atomic_write(path) as temporary:
        temporary.write_bytes(with_sorted_header(safetensors.numpy.save(arrays, metadata)))


def read(path: str | os.PathLike[str]) -> Content:
    """Read what `write` wrote; raises what `Field.load` raises."""
    try:
        data = Path(path).read_bytes()
        try:
            metadata, arrays = _metadata(data), safetensors.numpy.load(data)
        except (SafetensorError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"is cut short or no field: {error}") from error
        architecture, settings = _header(metadata)
        residuals = {name: arrays.pop(stored) for name, stored in RESIDUALS.items() if stored in arrays}
        if residuals and len(residuals) < len(RESIDUALS):
            raise ValueError(f"must hold {', '.join(RESIDUALS.values())}")
        _check_arrays(arrays, architecture)
    except ValueError as error:
        raise ValueError(f"Field.load: `path` {os.fspath(path)} {error}") from error
    center, scale, surface = arrays.pop("center"), arrays.pop("scale"), arrays.pop("surface", None)
    return Content(architecture, arrays, center, float(scale), settings, residuals or None, surface)


def with_sorted_header(content: bytes) -> bytes:
    """A safetensors file with its header in one order: safetensors writes metadata in another one every time."""
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + content[end:]


def _metadata(content: bytes) -> dict[str, str]:
    length = int.from_bytes(content[:8], "little")
    if length > len(content) - 8:
        raise ValueError(f"the header has {length:,} bytes, the file {len(content):,}")
    header = json.loads(content[8 : 8 + length])
    found = header.get("__metadata__", {}) if isinstance(header, dict) else {}
    return {name: text for name, text in found.items() if isinstance(text, str)} if isinstance(found, dict) else {}


def _header(metadata: Mapping[str, str]) -> tuple[Architecture, dict[str, Any]]:
    """The architecture and the settings that the metadata promises."""
    if metadata.get("format") != FORMAT:
        raise ValueError("is a safetensors file but no field")
    if metadata.get("version") != str(VERSION):
        raise ValueError(f"has version {metadata.get('version')}, this dfd reads {VERSION}")
    try:
        network, settings = json.loads(metadata["network"]), json.loads(metadata["settings"])
        if not isinstance(settings, dict):
            raise TypeError(f"settings must be an object, got {type(settings).__name__}")
        return Architecture(**network), settings
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"has an unreadable header: {error}") from error


def _check_arrays(arrays: Mapping[str, NDArray[Any]], architecture: Architecture) -> None:
    # Counted before they are listed: the header may promise more layers than there is memory for their names.
    promised = 4 * architecture.layers + 4
    if len(arrays) < promised:
        raise ValueError(f"must hold {promised} tensors for {architecture.layers} layers, found {len(arrays)}")
    wanted = {**architecture.shapes(), "center": (3,), "scale": (), "surface": (POINTS, 3)}
    for name, array in arrays.items():
        if name not in wanted:
            raise ValueError(f"holds an unknown tensor {name}")
        if array.shape != wanted[name]:
            raise ValueError(f"must hold {name} {wanted[name]}, found {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"holds numbers that are not finite in {name}")
    if float(arrays["scale"]) <= 0:
        raise ValueError(f"has scale {float(arrays['scale'])}, not above 0")
