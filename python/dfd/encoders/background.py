"""An encoder that is loaded on a thread of its own, while a shape is read."""

from __future__ import annotations

import os
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from dfd.encoders.sources import is_cached

# torch takes seconds to import, and is not needed to begin.
if TYPE_CHECKING:
    import torch

    from dfd.encoders.encode import Encoder

__all__ = ["load_in_background"]


def load_in_background(
    encoder: str | os.PathLike[str], *, device: str | torch.device | None = None, **options: Any
) -> Future[Encoder] | None:
    """Begin to load what `dfd.encoders.encode.load_encoder` loads; whoever asks for the result gets what that raises.

    None where it would have to be downloaded first: that takes as long as it takes, and should be waited for, or
    interrupted, where its result is wanted.
    """
    if not is_cached(encoder):
        return None

    def load() -> Encoder:
        from dfd.encoders.encode import load_encoder

        return load_encoder(encoder, device=device, **options)

    pool = ThreadPoolExecutor(1, "dfd-encoder")
    loading = pool.submit(load)
    pool.shutdown(wait=False)
    return loading
