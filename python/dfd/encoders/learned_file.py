"""What was learned about one encoder, as small .safetensors files that come with the package."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from dfd.common.files import atomic_write
from dfd.field.field_file import with_sorted_header

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder

__all__ = ["encoder_identity", "read_learned", "write_learned"]


def encoder_identity(encoder: Encoder) -> tuple[str, int]:
    """Hash of the weights and number of the block: what was learned fits an encoder that has the same two."""
    settings = encoder.settings()
    return str(settings["encoder_weights"]), int(settings["encoder_block"])


def write_learned(
    path: str | os.PathLike[str], kind: str, arrays: Mapping[str, NDArray[Any]], identity: tuple[str, int]
) -> None:
    """Write a file, whole or not at all; equal content makes equal files."""
    told = {"kind": kind, "encoder_weights": identity[0], "encoder_block": str(identity[1])}
    with atomic_write(Path(path)) as temporary:
        temporary.write_bytes(with_sorted_header(safetensors.numpy.save(dict(arrays), told)))


def read_learned(function: str, path: str | os.PathLike[str]) -> tuple[dict[str, str], dict[str, NDArray[Any]]]:
    """Read the metadata and the arrays of a file.

    Raises
    ------
    ValueError
        In the name of `function`, if it is no .safetensors file or cut short.
    OSError
        If it cannot be read.
    """
    try:
        with safe_open(path, framework="numpy") as file:
            return file.metadata() or {}, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise ValueError(f"{function}: {os.fspath(path)} is no whole .safetensors file: {error}") from None
