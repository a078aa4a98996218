"""Save a vision network that is small enough for tests, in the format of transformers."""

from __future__ import annotations

from pathlib import Path

import torch
import transformers


def save_tiny_encoder(folder: Path, seed: int = 0) -> Path:
    """Write a DINOv2 with random weights, three blocks and tokens of 16 numbers into `folder`."""
    config = transformers.Dinov2Config(
        hidden_size=16, num_hidden_layers=3, num_attention_heads=2, mlp_ratio=2, image_size=32, patch_size=8
    )
    transformers.utils.logging.disable_progress_bar()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        transformers.Dinov2Model(config).save_pretrained(folder)
    return folder
