"""Write a vision network for tests, in the format of transformers."""

from pathlib import Path

import torch
import transformers


def save_tiny_encoder(folder: Path, seed: int = 0) -> Path:
    """Write a DINOv2 of three blocks with 16 numbers per token and random weights into `folder`; return the folder."""
    config = transformers.Dinov2Config(
        hidden_size=16, num_hidden_layers=3, num_attention_heads=2, mlp_ratio=2, image_size=32, patch_size=8
    )
    transformers.utils.logging.disable_progress_bar()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        transformers.Dinov2Model(config).save_pretrained(folder)
    return folder
