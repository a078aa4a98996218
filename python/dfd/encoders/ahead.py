"""An encoder that is loaded beside what else is to be read: hardly any of its loading needs Python's lock."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from dfd.encoders.sources import at_hand

# torch takes seconds to import, and is not needed to begin.
if TYPE_CHECKING:
    import torch

    from dfd.encoders.encode import Encoder

__all__ = ["load_ahead"]


def load_ahead(
    encoder: str | os.PathLike[str], *, device: str | torch.device | None = None, **options: Any
) -> Future[Encoder] | None:
    """Begin to load what `dfd.encoders.encode.load_encoder` loads; whoever asks for the result gets what that raises.

    None where it would have to be downloaded first: that takes as long as it takes, and should be waited for, or
    interrupted, where its result is wanted.
    """
    if not at_hand(encoder):
        return None
    pool = ThreadPoolExecutor(1, "dfd-encoder")
    loading = pool.submit(_load, encoder, device, options)
    pool.shutdown(wait=False)
    return loading


def _load(encoder: str | os.PathLike[str], device: str | torch.device | None, options: dict[str, Any]) -> Encoder:
    from dfd.encoders.encode import load_encoder

    return load_encoder(encoder, device=device, **options)
