"""Identify an encoder without loading it, and without importing torch, which takes seconds."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from dfd.encoders.precision import choose_precision, default_device
from dfd.encoders.sources import find_fingerprint

if TYPE_CHECKING:
    import torch

    from dfd.encoders.encode import Encoder


def find_identity(
    encoder: str | os.PathLike[str] | Encoder, device: str | torch.device | None = None
) -> dict[str, Any] | None:
    """Return all that the tokens of `encoder` on `device` depend on, besides the pictures, without loading it.

    None where its weights are not cached.
    """
    if not isinstance(encoder, str | os.PathLike):
        return encoder.identity()
    weights = find_fingerprint(encoder)
    if weights is None:
        return None
    target = default_device() if device is None else str(device)
    found = {"encoder": os.fspath(encoder), "encoder_weights": weights}
    return found | {"encoder_precision": choose_precision(target), "device": target}


def loaded_identity(
    encoder: str | os.PathLike[str] | Encoder, device: str | torch.device | None, model: Encoder
) -> dict[str, Any]:
    """Return the same once `encoder` is loaded as `model`.

    What was known before may not be what was loaded: the hub may have given other weights than those in its cache.
    """
    identity = model.identity()
    known = find_identity(encoder, device)
    if known is None or not str(known["encoder_weights"]).startswith(str(identity["encoder_weights"])):
        return identity
    same = all(known[name] == identity[name] for name in ("encoder_precision", "device"))
    return known if same else identity
