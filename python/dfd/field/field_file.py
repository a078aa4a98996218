"""Read and write field files: safetensors files with the architecture and the settings in the metadata."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from dfd.common.files import write_file
from dfd.field.architecture import Architecture

FORMAT = "dfd-field"
VERSION = 1


def write(
    path: str | os.PathLike[str],
    architecture: Architecture | None,
    arrays: Mapping[str, NDArray[Any]],
    settings: Mapping[str, Any],
) -> None:
    """Write a field atomically; raises the errors of `Field.save`. A `VertexField` has no architecture."""
    metadata = {
        "format": FORMAT,
        "version": str(VERSION),
        "network": json.dumps(None if architecture is None else asdict(architecture)),
        "settings": json.dumps(settings, sort_keys=True),
    }
    write_file(path, with_sorted_header(safetensors.numpy.save(dict(arrays), metadata)))


def read(path: str | os.PathLike[str]) -> tuple[Architecture | None, dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the architecture, the arrays and the settings of a field file; raises the errors of `Field.load`.

    The architecture of a `VertexField` is None.
    """
    try:
        try:
            with safe_open(path, framework="numpy") as file:
                metadata, arrays = file.metadata() or {}, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"is truncated or not a field: {error}") from error
        architecture, settings = _header(metadata)
    except ValueError as error:
        raise ValueError(f"Field.load: `path` {os.fspath(path)} {error}") from error
    return architecture, arrays, settings


def with_sorted_header(content: bytes) -> bytes:
    """Return the `content` of a safetensors file with a sorted header; the library writes metadata in random order."""
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + content[end:]


def _header(metadata: Mapping[str, str]) -> tuple[Architecture | None, dict[str, Any]]:
    """Return the architecture and the settings in the metadata."""
    if metadata.get("format") != FORMAT:
        raise ValueError("is a safetensors file, but not a field")
    if metadata.get("version") != str(VERSION):
        raise ValueError(f"must have version {VERSION}, got {metadata.get('version')}")
    try:
        network, settings = json.loads(metadata["network"]), json.loads(metadata["settings"])
        if not isinstance(settings, dict):
            raise TypeError(f"settings must be an object, got {type(settings).__name__}")
        return None if network is None else Architecture(**network), settings
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"has an unreadable header: {error}") from error
