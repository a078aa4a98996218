"""Read and write the package's learned files: small .safetensors files with data learned for one encoder."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from dfd.common import check
from dfd.common.files import write_file
from dfd.field.field_file import with_sorted_header

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder


def encoder_identity(encoder: Encoder) -> tuple[str, int]:
    """Return the encoder's fingerprint and block. Learned data is valid only for encoders with the same two values."""
    settings = encoder.settings()
    return str(settings["encoder_weights"]), int(settings["encoder_block"])


def write_learned(
    path: str | os.PathLike[str], kind: str, arrays: Mapping[str, NDArray[Any]], identity: tuple[str, int]
) -> None:
    """Write a learned file atomically; equal content gives equal bytes."""
    metadata = {"kind": kind, "encoder_weights": identity[0], "encoder_block": str(identity[1])}
    write_file(path, with_sorted_header(safetensors.numpy.save(dict(arrays), metadata)))


def read_learned(
    function: str,
    path: str | os.PathLike[str],
    kind: str,
    shapes: Mapping[str, tuple[int | str, ...]],
    optional: Collection[str] = (),
) -> tuple[dict[str, NDArray[Any]], tuple[str, int]]:
    """Return the arrays of a learned file, and the `encoder_identity` of the encoder for which they were learned.

    `kind` names the type of data and its version. `shapes` maps the name of each array to its array shape, in which a
    name such as "D" stands for any number, equal in all arrays. The file must have all arrays of `optional`, or none.

    Raises ValueError, with `function` in the message, if the file is not a complete .safetensors file of this `kind`.
    Raises ValueError if an array has another shape or is not finite. Raises OSError if the file cannot be read.
    """
    name = os.fspath(path)
    try:
        with safe_open(path, framework="numpy") as file:
            metadata, found = file.metadata() or {}, {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise ValueError(f"{function}: {name} is not a complete .safetensors file: {error}") from None
    block = metadata.get("encoder_block", "")
    whole = found.keys() in (shapes.keys(), shapes.keys() - set(optional))
    if metadata.get("kind") != kind or not block.isdecimal() or not whole:
        raise ValueError(f"{function}: {name} does not hold {kind}")
    sizes: dict[int | str, int] = {}
    arrays = {}
    for key in (key for key in shapes if key in found):
        wanted = [sizes.get(size, size) for size in shapes[key]]
        try:
            array = check.array(function, key, found[key], wanted, dtype=found[key].dtype)
        except ValueError as error:
            raise ValueError(f"{error} in {name}") from None
        sizes |= {size: length for size, length in zip(shapes[key], array.shape, strict=True) if isinstance(size, str)}
        arrays[key] = array
    return arrays, (metadata.get("encoder_weights", ""), int(block))
