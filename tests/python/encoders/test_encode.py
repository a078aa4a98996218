"""Encoders of every family, through the real loading code, on tiny networks with random weights."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import transformers

import dfd
import dfd.encoders.encode
from dfd.common.progress import Stages
from dfd.encoders import families
from dfd.encoders.attention import blocked_attention, use_blocked_attention
from dfd.encoders.encode import Encoder, load_encoder
from dfd.encoders.presets import PRESETS

VISION = {
    "hidden_size": 16,
    "intermediate_size": 32,
    "num_hidden_layers": 3,
    "num_attention_heads": 2,
    "image_size": 32,
    "patch_size": 8,
    "initializer_range": 0.2,
}
TEXT = {
    "hidden_size": 16,
    "intermediate_size": 32,
    "num_hidden_layers": 1,
    "num_attention_heads": 2,
    "vocab_size": 16,
    "max_position_embeddings": 8,
}
HIERA = {
    "hidden_size": 8,
    "image_size": [64, 64],
    "window_positional_embedding_background_size": [4, 4],
    "blocks_per_stage": [1, 1, 2, 1],
    "embed_dim_per_stage": [8, 16, 32, 64],
    "num_attention_heads_per_stage": [1, 2, 4, 8],
    "window_size_per_stage": [4, 2, 4, 2],
    "global_attention_blocks": [3],
}
SAM2_VISION = {
    "backbone_config": {"model_type": "sam2_hiera_det_model", **HIERA},
    "backbone_channel_list": [64, 32, 16, 8],
    "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
    "fpn_hidden_size": 8,
}
SAM_DECODER = {"hidden_size": 8, "mlp_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2}


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(autouse=True)
def _no_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")


def _dinov2() -> Any:
    config = {key: value for key, value in VISION.items() if key != "intermediate_size"}
    return transformers.Dinov2Model(transformers.Dinov2Config(**config, mlp_ratio=2))


def _registers() -> Any:
    config = {key: value for key, value in VISION.items() if key != "intermediate_size"}
    config = transformers.Dinov2WithRegistersConfig(**config, mlp_ratio=2, num_register_tokens=3)
    return transformers.Dinov2WithRegistersModel(config)


def _dinov3() -> Any:
    return transformers.DINOv3ViTModel(transformers.DINOv3ViTConfig(**VISION, num_register_tokens=3))


def _convnext() -> Any:
    config = transformers.DINOv3ConvNextConfig(hidden_sizes=[8, 12, 16, 24], depths=[1, 1, 1, 1], image_size=64)
    return transformers.DINOv3ConvNextModel(config)


def _clip() -> Any:
    return transformers.CLIPModel(transformers.CLIPConfig(text_config=TEXT, vision_config=VISION, projection_dim=8))


def _siglip() -> Any:
    return transformers.SiglipModel(transformers.SiglipConfig(text_config=TEXT, vision_config=VISION))


def _siglip2() -> Any:
    vision = {key: value for key, value in VISION.items() if key != "image_size"} | {"num_patches": 16}
    return transformers.Siglip2Model(transformers.Siglip2Config(text_config=TEXT, vision_config=vision))


def _sam() -> Any:
    vision = {
        "hidden_size": 16,
        "output_channels": 8,
        "num_hidden_layers": 3,
        "num_attention_heads": 2,
        "image_size": 64,
        "patch_size": 16,
        "window_size": 2,
        "global_attn_indexes": [1],
        "mlp_dim": 32,
        "num_pos_feats": 4,
        "initializer_range": 0.2,
    }
    prompt = {
        "hidden_size": 8,
        "image_size": 64,
        "patch_size": 16,
        "image_embedding_size": 4,
        "mask_input_channels": 4,
    }
    config = transformers.SamConfig(
        vision_config=vision,
        prompt_encoder_config=prompt,
        mask_decoder_config={**SAM_DECODER, "iou_head_hidden_dim": 8},
    )
    return transformers.SamModel(config)


def _sam2(kind: str = "Sam2") -> Any:
    config = getattr(transformers, f"{kind}Config")(
        vision_config=transformers.Sam2VisionConfig(**SAM2_VISION),
        prompt_encoder_config={"hidden_size": 8, "image_size": 64},
        mask_decoder_config={**SAM_DECODER, "iou_head_hidden_dim": 8},
    )
    return getattr(transformers, f"{kind}Model")(config)


def _mae() -> Any:
    decoder = {f"decoder_{key}": TEXT[key] for key in ("hidden_size", "num_hidden_layers", "num_attention_heads")}
    return transformers.ViTMAEForPreTraining(transformers.ViTMAEConfig(**VISION, **decoder))


def _vit() -> Any:
    return transformers.ViTForImageClassification(transformers.ViTConfig(**VISION))


def _beit() -> Any:
    return transformers.BeitModel(transformers.BeitConfig(**VISION, use_absolute_position_embeddings=True))


# What each family's own code gives for normalised images (n, 3, H, W): the tokens (n, h·w, D) of its second block, and
# of the block that is its default, computed from the whole model's hidden states.


def _hidden(model: Any, images: torch.Tensor, block: int, **options: Any) -> torch.Tensor:
    return model(pixel_values=images, output_hidden_states=True, **options).hidden_states[block]


def _twin_backbone(kind: str) -> Callable[[Any, torch.Tensor, int], torch.Tensor]:
    def twin(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
        settings = {key: value for key, value in model.config.to_dict().items() if not key.startswith("out_")}
        config = model.config.__class__(**settings, out_indices=[block])
        backbone = getattr(transformers, kind)(config).eval()
        names = backbone.load_state_dict(model.state_dict(), strict=False)
        assert not names.missing_keys
        return backbone(images).feature_maps[0].flatten(2).transpose(1, 2)

    return twin


def _twin_convnext(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    maps = _hidden(model, images, block).flatten(2).transpose(1, 2)
    return model.layer_norm(maps) if block == 4 else maps


def _twin_clip(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    vision = model.vision_model
    return vision.post_layernorm(_hidden(vision, images, block, interpolate_pos_encoding=True))[:, 1:]


def _twin_siglip(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    vision = model.vision_model
    return vision.post_layernorm(_hidden(vision, images, block, interpolate_pos_encoding=True))


def _twin_siglip2(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    rows, columns = images.shape[2] // 8, images.shape[3] // 8
    patches = [
        images[:, :, 8 * row : 8 * row + 8, 8 * column : 8 * column + 8].permute(0, 2, 3, 1).flatten(1)
        for row in range(rows)
        for column in range(columns)
    ]
    hidden = model.vision_model(
        pixel_values=torch.stack(patches, 1),
        pixel_attention_mask=torch.ones(len(images), rows * columns),
        spatial_shapes=torch.tensor([[rows, columns]] * len(images)),
        output_hidden_states=True,
    ).hidden_states[block]
    return model.vision_model.post_layernorm(hidden)


def _twin_sam(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    encoder = model.vision_encoder
    states = encoder(images, output_hidden_states=True).hidden_states
    return encoder.neck(states[block]).flatten(2).transpose(1, 2)


def _twin_sam2(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    backbone = model.vision_encoder.backbone
    caught: list[torch.Tensor] = []
    hook = backbone.blocks[block - 1].register_forward_hook(lambda module, given, result: caught.append(result))
    backbone(images)
    hook.remove()
    return caught[0].flatten(1, 2)


def _twin_mae(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    model.config.mask_ratio = 0.0
    output = model.vit(pixel_values=images, interpolate_pos_encoding=True, output_hidden_states=True)
    tokens = model.vit.layernorm(output.hidden_states[block])[:, 1:]
    return torch.gather(tokens, 1, output.ids_restore[:, :, None].expand_as(tokens))


def _twin_vit(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    return model.vit.layernorm(_hidden(model.vit, images, block, interpolate_pos_encoding=True))[:, 1:]


def _twin_beit(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    hidden = _hidden(model, images, block)
    return model.layernorm(hidden)[:, 1:] if model.layernorm is not None else hidden[:, 1:]


@dataclass(frozen=True)
class Case:
    make: Callable[[], Any]
    twin: Callable[[Any, torch.Tensor, int], torch.Tensor]
    size: int = 48
    patch: int = 8
    dimension: int = 16
    block: int = 3
    early: int = 2
    early_patch: int = 8


CASES = {
    "dinov2": Case(_dinov2, _twin_backbone("Dinov2Backbone")),
    "dinov2-registers": Case(_registers, _twin_backbone("Dinov2WithRegistersBackbone")),
    "dinov3": Case(_dinov3, _twin_backbone("DINOv3ViTBackbone")),
    "dinov3-convnext": Case(_convnext, _twin_convnext, 128, 32, 24, 4, 3, 16),
    "clip": Case(_clip, _twin_clip),
    "siglip": Case(_siglip, _twin_siglip),
    "siglip2": Case(_siglip2, _twin_siglip2),
    "sam": Case(_sam, _twin_sam, 64, 16, 8, early_patch=16),
    "sam2": Case(_sam2, _twin_sam2, 96, 16, 32, 4, 2),
    "sam2-video": Case(lambda: _sam2("Sam2Video"), _twin_sam2, 96, 16, 32, 4, 2),
    "mae": Case(_mae, _twin_mae),
    "vit": Case(_vit, _twin_vit),
    "unknown": Case(_beit, _twin_beit, 32),
}


@dataclass(frozen=True)
class Saved:
    case: Case
    model: Any
    folder: Path


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Saved]:
    """A tiny model of each family, random weights, saved as transformers saves it."""
    made: dict[str, Saved] = {}

    def get(name: str) -> Saved:
        if name not in made:
            torch.manual_seed(7)
            model = CASES[name].make().eval()
            with torch.no_grad():  # biases, norms and position tables start at 0 or 1, where mistakes would not show
                for parameter in model.parameters():
                    parameter.add_(torch.randn_like(parameter) * 0.05)
            folder = tmp_path_factory.mktemp(name)
            transformers.utils.logging.disable_progress_bar()
            model.save_pretrained(folder)
            made[name] = Saved(CASES[name], model, folder)
        return made[name]

    return get


@pytest.fixture
def dinov2(saved: Callable[[str], Saved]) -> Saved:
    return saved("dinov2")


def pictures(count: int, size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, size, size, 3), dtype=np.uint8)


def normalised(encoder: Encoder, images: np.ndarray) -> torch.Tensor:
    """What the network is to be given, computed in NumPy."""
    mean = np.array(encoder._model.normalisation.mean)
    std = np.array(encoder._model.normalisation.std)
    values = (images.astype(np.float64) / 255 - mean) / std
    return torch.from_numpy(values.transpose(0, 3, 1, 2).astype(np.float32))


@pytest.mark.parametrize("name", CASES)
def test_tokens_are_the_hidden_states_of_the_whole_model(name: str, saved: Callable[[str], Saved]) -> None:
    one = saved(name)
    images = pictures(2, one.case.size)
    for block, patch in ((None, one.case.patch), (one.case.early, one.case.early_patch)):
        encoder = load_encoder(one.folder, block=block, device="cpu", precision="float32")
        assert encoder.block == (block or one.case.block)
        assert encoder.patch == patch
        tokens = encoder.encode(images)
        side = one.case.size // patch
        assert tokens.shape == (2, side, side, encoder.dimension)
        assert tokens.dtype == np.float32
        with torch.no_grad():
            expected = one.case.twin(one.model, normalised(encoder, images), encoder.block).numpy()
        np.testing.assert_allclose(tokens.reshape(expected.shape), expected, atol=1e-4 * np.abs(expected).max())
    assert load_encoder(one.folder, device="cpu").dimension == one.case.dimension


@pytest.mark.parametrize("name", CASES)
def test_the_token_of_a_changed_corner_changes_most(name: str, saved: Callable[[str], Saved]) -> None:
    one = saved(name)
    encoder = load_encoder(one.folder, block=1 if name != "dinov3-convnext" else None, device="cpu")
    images = np.full((2, one.case.size, one.case.size, 3), 128, np.uint8)
    images[1, : encoder.patch, -encoder.patch :] = pictures(1, encoder.patch)[0]  # upper right
    tokens = encoder.encode(images)
    change = np.linalg.norm(tokens[1] - tokens[0], axis=-1)
    row, column = np.unravel_index(change.argmax(), change.shape)
    # SAM's networks blur their tokens with their neighbours, so the quarter of the picture is what is certain.
    assert row < change.shape[0] / 2
    assert column >= change.shape[1] / 2


def test_every_preset_says_what_it_needs() -> None:
    for name, preset in PRESETS.items():
        assert preset.name == name
        assert preset.resolution % preset.patch == 0
        assert preset.hub.count("/") == 1
    assert PRESETS["dinov2-small"].block is None


def test_images_are_not_changed_and_results_repeat(dinov2: Saved) -> None:
    images = pictures(3, 48)
    before = images.copy()
    encoder = load_encoder(dinov2.folder, device="cpu")
    first = encoder.encode(images)
    assert np.array_equal(images, before)
    assert np.array_equal(first, encoder.encode(images))
    assert np.array_equal(first, load_encoder(dinov2.folder, device="cpu").encode(images))


def test_threads_do_not_show(dinov2: Saved) -> None:
    images = pictures(5, 48)
    encoder = load_encoder(dinov2.folder, device="cpu", precision="float32")
    before = dfd.get_num_threads()
    try:
        dfd.set_num_threads(1)
        alone = encoder.encode(images)
        dfd.set_num_threads(3)
        assert np.array_equal(encoder.encode(images), alone)
    finally:
        dfd.set_num_threads(before)


def test_read_only_and_flipped_images_are_taken(dinov2: Saved) -> None:
    images = pictures(2, 48)
    encoder = load_encoder(dinov2.folder, device="cpu", precision="float32")
    turned = encoder.encode(images[:, :, ::-1])
    images.setflags(write=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        encoder.encode(images)
    np.testing.assert_array_equal(turned, encoder.encode(np.ascontiguousarray(images[:, :, ::-1])))


def test_no_images_give_no_tokens(dinov2: Saved) -> None:
    assert load_encoder(dinov2.folder, device="cpu").encode(np.empty((0, 32, 32, 3), np.uint8)).shape == (0, 4, 4, 16)


def test_mirrored_tokens_are_the_mean_of_both_and_know_no_side(dinov2: Saved) -> None:
    images = pictures(2, 48)
    encoder = load_encoder(dinov2.folder, device="cpu", precision="float32")
    both = encoder.encode(images, mirror=True)
    expected = (encoder.encode(images) + encoder.encode(images[:, :, ::-1])[:, :, ::-1]) / 2
    np.testing.assert_allclose(both, expected, atol=1e-5)
    np.testing.assert_allclose(encoder.encode(images[:, :, ::-1], mirror=True), both[:, :, ::-1], atol=1e-5)


def square(count: int, size: int) -> np.ndarray:
    """The pixels of a shape that covers 3 × 2 patches of 8 pixels in the middle of the left, one pixel over."""
    covered = np.zeros((count, size, size), bool)
    covered[:, 16:41, 0:16] = True
    return covered


@pytest.mark.parametrize("name", ["dinov2", "dinov2-registers"])
def test_the_background_takes_no_part(name: str, saved: Callable[[str], Saved]) -> None:
    encoder = load_encoder(saved(name).folder, device="cpu", precision="float32")
    images = pictures(2, 64)
    tokens = encoder.encode(images, covered=square(2, 64))
    kept = np.zeros((8, 8), bool)
    kept[1:7, 0:3] = True  # with the patches beside it, and beside the one that a single row of pixels reaches
    assert (tokens[:, ~kept] == 0).all()
    # The network's own modules, on the sequence without those patches.
    network = encoder._model.network
    with torch.no_grad():
        sequence = network.embeddings(normalised(encoder, images))
        prefix = sequence.shape[1] - 64
        chosen = torch.from_numpy(np.concatenate([np.arange(prefix), prefix + np.flatnonzero(kept)]))
        expected = network.layernorm(network.encoder(sequence[:, chosen]).last_hidden_state)[:, prefix:].numpy()
    np.testing.assert_allclose(tokens[:, kept], expected, atol=1e-4 * np.abs(expected).max())
    changed = np.where(np.kron(kept, np.ones((8, 8)))[None, :, :, None] > 0, images, 255 - images).astype(np.uint8)
    np.testing.assert_array_equal(encoder.encode(changed, covered=square(2, 64)), tokens)
    assert not np.array_equal(encoder.encode(changed), encoder.encode(images))


def test_every_picture_has_its_own_foreground(dinov2: Saved) -> None:
    encoder = load_encoder(dinov2.folder, device="cpu", precision="float32")
    images, covered = pictures(3, 64), square(3, 64)
    covered[1] = covered[1].T
    covered[2] = False
    tokens = encoder.encode(images, covered=covered, mirror=True)
    for one in range(2):
        alone = encoder.encode(images[one : one + 1], covered=covered[one : one + 1])
        turned = encoder.encode(images[one : one + 1, :, ::-1], covered=covered[one : one + 1, :, ::-1])
        np.testing.assert_allclose(tokens[one], (alone[0] + turned[0, :, ::-1]) / 2, atol=1e-5)
    assert (tokens[2] == 0).all()  # nothing to see


def test_a_whole_foreground_is_the_whole_picture(dinov2: Saved) -> None:
    encoder = load_encoder(dinov2.folder, device="cpu", precision="float32")
    images = pictures(2, 48)
    np.testing.assert_array_equal(encoder.encode(images, covered=np.ones((2, 48, 48), bool)), encoder.encode(images))


@pytest.mark.parametrize("name", ["dinov3", "dinov3-convnext", "clip", "sam", "mae"])
def test_networks_that_cannot_do_without_see_the_background(name: str, saved: Callable[[str], Saved]) -> None:
    one = saved(name)
    encoder = load_encoder(one.folder, device="cpu", precision="float32")
    images = pictures(1, one.case.size)
    covered = np.zeros(images.shape[:3], bool)
    covered[0, 0, 0] = True
    np.testing.assert_array_equal(encoder.encode(images, covered=covered), encoder.encode(images))
    assert encoder.settings()["encoder_foreground_only"] is False


def test_large_networks_without_registers_see_the_background() -> None:
    takes = {name: families._FAMILIES[name].takes_patches for name in ("dinov2", "dinov2_with_registers")}
    for width, alone in ((384, True), (768, True), (1024, False), (1536, False)):
        assert takes["dinov2"](transformers.Dinov2Config(hidden_size=width)) is alone
        assert takes["dinov2_with_registers"](transformers.Dinov2WithRegistersConfig(hidden_size=width)) is True


@pytest.mark.parametrize(
    "covered", [np.ones((2, 48, 48), np.uint8), np.ones((2, 48, 47), bool), np.ones((1, 48, 48), bool)]
)
def test_a_foreground_of_another_form_is_refused(dinov2: Saved, covered: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"encode: `covered` must be bool of shape \(2, 48, 48\), got"):
        load_encoder(dinov2.folder, device="cpu").encode(pictures(2, 48), covered=covered)


def test_progress_counts_images(dinov2: Saved) -> None:
    counted: list[int] = []

    class Counting(Stages):
        @contextmanager
        def stage(self, name: str, total: int | None = None) -> Iterator[Any]:
            assert (name, total) == ("encode", 5)
            yield counted.append

    load_encoder(dinov2.folder, device="cpu").encode(pictures(5, 32), stages=Counting(show=False))
    assert counted == [1] * 5


@pytest.mark.parametrize(("given", "used"), [(50, 48), (52, 56), (3, 8)])
def test_other_resolutions_are_resized_and_said_once(dinov2: Saved, given: int, used: int) -> None:
    encoder = load_encoder(dinov2.folder, device="cpu")
    assert encoder.nearest_resolution(given) == used
    with pytest.warns(UserWarning, match=f"resolution of {given} is no multiple of the 8 pixels.*resized to {used}"):
        tokens = encoder.encode(pictures(1, given))
    assert tokens.shape == (1, used // 8, used // 8, 16)
    encoder.encode(pictures(1, given))  # a second warning would fail


def test_a_resized_picture_keeps_its_last_pixels(dinov2: Saved) -> None:
    encoder = load_encoder(dinov2.folder, block=1, device="cpu", precision="float32")
    images = np.full((2, 51, 51, 3), 128, np.uint8)
    images[1, -3:, -3:] = 255  # what cropping 51 to 48 pixels would lose
    with pytest.warns(UserWarning, match="resized to 48"):
        tokens = encoder.encode(images)
    change = np.linalg.norm(tokens[1] - tokens[0], axis=-1)
    assert np.unravel_index(change.argmax(), change.shape) == (5, 5)


def test_networks_of_one_size_get_it(saved: Callable[[str], Saved]) -> None:
    encoder = load_encoder(saved("sam").folder, device="cpu")
    assert encoder.nearest_resolution(518) == 64
    assert encoder.encode(pictures(1, 40)).shape == (1, 4, 4, 8)


@pytest.mark.parametrize("name", CASES)
def test_bfloat16_stays_close_to_float32(name: str, saved: Callable[[str], Saved]) -> None:
    one = saved(name)
    images = pictures(2, one.case.size)
    full = load_encoder(one.folder, device="cpu", precision="float32").encode(images)
    half = load_encoder(one.folder, device="cpu", precision="bfloat16").encode(images)
    assert half.dtype == np.float32
    full /= np.linalg.norm(full, axis=-1, keepdims=True)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    assert 0 < np.linalg.norm(full - half, axis=-1).mean() < 0.03


@pytest.mark.parametrize("rows", [1, 255, 256, 700])
def test_blocked_attention_is_attention(rows: int) -> None:
    generator = torch.Generator().manual_seed(0)
    query, key, value = (torch.randn(2, 3, rows, 8, generator=generator) for _ in range(3))
    key += 4.0  # what all keys share is taken off, and must make no difference
    expected = torch.nn.functional.scaled_dot_product_attention(query, key, value)
    result, _ = blocked_attention(torch.nn.Identity(), query, key, value, None, 8**-0.5)
    assert (result.float().transpose(1, 2) - expected).abs().max() < 0.03


def test_blocked_attention_heeds_masks_and_shared_keys() -> None:
    generator = torch.Generator().manual_seed(0)
    query, key, value = (torch.randn(1, 4, 6, 8, generator=generator) for _ in range(3))
    mask = torch.ones(1, 1, 6, 6, dtype=torch.bool).tril()
    result, _ = blocked_attention(torch.nn.Identity(), query, key, value, mask)
    expected = torch.nn.functional.scaled_dot_product_attention(query, key, value, attn_mask=mask)
    torch.testing.assert_close(result.transpose(1, 2), expected)
    result, _ = blocked_attention(torch.nn.Identity(), query, key[:, :2], value[:, :2])
    expected = torch.nn.functional.scaled_dot_product_attention(query, key[:, :2], value[:, :2], enable_gqa=True)
    torch.testing.assert_close(result.transpose(1, 2), expected)


def test_blocked_attention_leaves_amx_to_torch(dinov2: Saved, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dfd.encoders.attention._cpu_has", lambda feature: feature == "amx_tile")
    network = load_encoder(dinov2.folder, device="cpu", precision="float32")._model.network
    use_blocked_attention(network)
    assert network.config._attn_implementation == "sdpa"


def test_precision_is_chosen_by_the_processor(dinov2: Saved, monkeypatch: pytest.MonkeyPatch) -> None:
    for has, pays, expected in ((True, True, "bfloat16"), (True, False, "float32"), (False, True, "float32")):
        monkeypatch.setattr("dfd.encoders.attention._cpu_has", lambda feature, has=has: has)
        monkeypatch.setattr("dfd.encoders.attention._bfloat16_pays", lambda pays=pays: pays)
        encoder = load_encoder(dinov2.folder, device="cpu", precision="auto")
        assert encoder.settings()["encoder_precision"] == expected


def test_settings_tell_encoders_apart(dinov2: Saved, saved: Callable[[str], Saved]) -> None:
    first = load_encoder(dinov2.folder, device="cpu", precision="float32").settings()
    assert first["encoder_block"] == 3
    assert first["encoder_dimension"] == 16
    assert first["encoder_weights"].startswith("sha256:")
    assert json.loads(json.dumps(first)) == first
    assert load_encoder(dinov2.folder, block=2, device="cpu", precision="float32").settings() != first
    assert load_encoder(dinov2.folder, device="cpu", precision="bfloat16").settings() != first
    other = load_encoder(saved("dinov2-registers").folder, device="cpu", precision="float32").settings()
    assert other["encoder_weights"] != first["encoder_weights"]


def test_blocks_after_the_one_used_are_gone(dinov2: Saved) -> None:
    encoder = load_encoder(dinov2.folder, block=np.int64(1), device="cpu")
    assert json.dumps(encoder.settings())
    assert len(encoder._model.network.encoder.layer) == 1


@pytest.mark.parametrize("block", [0, -1, 4, 2.0, True, "2"])
def test_blocks_that_are_not_there_are_refused(dinov2: Saved, block: Any) -> None:
    with pytest.raises(ValueError, match=r"load_encoder: `block` must lie in 1 … 3, got"):
        load_encoder(dinov2.folder, block=block, device="cpu")


def test_unknown_precision_and_device_are_refused(dinov2: Saved) -> None:
    with pytest.raises(ValueError, match="`precision` must be one of auto, float32, bfloat16, got 'half'"):
        load_encoder(dinov2.folder, precision="half")
    for device in ("abacus", "cuda:99"):
        with pytest.raises(ValueError, match=f"`device` must be one that torch can use, got '{device}'"):
            load_encoder(dinov2.folder, device=device)


@pytest.mark.parametrize(
    ("images", "found"),
    [
        (np.zeros((1, 32, 32, 3), np.float32), "float32 of shape"),
        (np.zeros((32, 32, 3), np.uint8), r"\(32, 32, 3\)"),
        (np.zeros((1, 32, 32, 4), np.uint8), r"\(1, 32, 32, 4\)"),
        (np.zeros((1, 0, 0, 3), np.uint8), r"\(1, 0, 0, 3\)"),
        (np.zeros((1, 32, 40, 3), np.uint8), "square, got 40 × 32"),
    ],
)
def test_images_that_are_no_pictures_are_refused(dinov2: Saved, images: np.ndarray, found: str) -> None:
    encoder = load_encoder(dinov2.folder, device="cpu")
    with pytest.raises(ValueError, match=f"encode: `images` must be .*{found}"):
        encoder.encode(images)


def test_tokens_that_are_not_finite_are_refused(dinov2: Saved) -> None:
    encoder = load_encoder(dinov2.folder, device="cpu")
    with torch.no_grad():
        encoder._model.network.layernorm.bias[3] = torch.nan
    with pytest.raises(ValueError, match="gave NaN or infinity"):
        encoder.encode(pictures(1, 32))


OUT_OF_MEMORY = [torch.cuda.OutOfMemoryError(), RuntimeError("can't allocate memory: you tried")]


@pytest.mark.parametrize("error", OUT_OF_MEMORY)
def test_a_device_with_too_little_memory_gets_smaller_batches(error: RuntimeError) -> None:
    filled: list[tuple[int, int]] = []
    limit = 1

    def fill(begin: int, end: int) -> None:
        if end - begin > limit:
            raise error
        filled.append((begin, end))

    Encoder._fill_on_device(5, 4, fill)
    assert filled == [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)]
    limit = 0
    with pytest.raises(type(error)):
        Encoder._fill_on_device(5, 4, fill)


@pytest.mark.parametrize("error", OUT_OF_MEMORY)
def test_too_little_memory_for_one_image_says_what_to_lower(
    dinov2: Saved, monkeypatch: pytest.MonkeyPatch, error: RuntimeError
) -> None:
    def fail(*_: Any, **__: Any) -> np.ndarray:
        raise error

    monkeypatch.setattr(Encoder, "_forward", fail)
    with pytest.raises(MemoryError, match="lower the resolution"):
        load_encoder(dinov2.folder, device="cpu").encode(pictures(5, 32))
