"""Test that DINOv2 in plain torch gives the tokens of the model in transformers, without importing transformers."""

import subprocess
import sys

import pytest
import safetensors.torch
import torch

from dfd.encoders.dinov2 import build_dinov2
from dfd.encoders.sources import find_weights

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.mark.parametrize("size", [(32, 32), (48, 24), (16, 16)])  # the size of its position table, and two others
def test_its_tokens_are_those_of_transformers(dinov2, size):
    images = torch.randn(2, 3, *size, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        mine = build_dinov2(find_weights(dinov2.folder), None).tokens(images, None)
        wanted = dinov2.model(images).last_hidden_state[:, -mine.shape[1] * mine.shape[2] :].reshape(mine.shape)
    torch.testing.assert_close(mine, wanted, atol=1e-5 * float(wanted.abs().max()), rtol=0)


def test_pictures_of_other_lengths_do_not_mix(dinov2):
    tokens = build_dinov2(find_weights(dinov2.folder), 2).tokens
    generator = torch.Generator().manual_seed(2)
    images = torch.randn(3, 3, 32, 32, generator=generator)
    patches = torch.rand(3, 4, 4, generator=generator) < 0.5
    patches[1] = False
    with torch.no_grad():
        together = tokens(images, patches)
        alone = torch.cat([tokens(image[None], shown[None]) for image, shown in zip(images, patches, strict=True)])
    torch.testing.assert_close(together, alone, atol=1e-5, rtol=0)
    assert (together[~patches] == 0).all()
    assert (together[patches] != 0).all()


def test_names_of_older_files_are_known(folder):
    images = torch.randn(1, 3, 32, 32)
    with torch.no_grad():
        wanted = build_dinov2(find_weights(folder), None).tokens(images, None)
    file = folder / "model.safetensors"
    tensors = safetensors.torch.load_file(file)
    of_today = {
        "attention.q_proj": "attention.attention.query",
        "attention.k_proj": "attention.attention.key",
        "attention.v_proj": "attention.attention.value",
        "attention.o_proj": "attention.output.dense",
    }
    older: dict[str, torch.Tensor] = {}
    for name, tensor in tensors.items():
        for new, old in of_today.items():
            name = name.replace(new, old)
        older[f"dinov2.{name}"] = tensor
    safetensors.torch.save_file(older, file)
    assert not any("q_proj" in name for name in older)
    with torch.no_grad():
        assert torch.equal(build_dinov2(find_weights(folder), None).tokens(images, None), wanted)


def test_a_shape_is_distilled_without_transformers(folder):
    code = (
        "import sys\nimport dfd\nfrom dfd.encoders.encode import load_encoder\n"
        f"encoder = load_encoder({str(folder)!r}, device='cpu')\n"
        "mesh = dfd.samples.chair(4000).mesh\n"
        "field = dfd.distill(mesh, encoder, views=4, resolution=32, steps=5, progress=False, cache=False)\n"
        "assert field(mesh.vertices).shape == (len(mesh.vertices), 16)\n"
        "print(sorted({'transformers', 'onnx', 'huggingface_hub'} & sys.modules.keys()))"
    )
    asked = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert asked.stdout.strip() == "[]"


@pytest.mark.parametrize("odd", [{"hidden_act": "relu"}, {"num_attention_heads": 3}, {"patch_size": [8, 8]}])
def test_other_networks_are_refused(folder, odd):
    weights = find_weights(folder)
    weights.config.update(odd)
    with pytest.raises(ValueError, match=f"config.json of a dinov2 model, got `{next(iter(odd))}`: "):
        build_dinov2(weights, None)
