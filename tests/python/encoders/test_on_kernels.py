"""DINOv2 by our kernels gives what torch gives, and leaves to torch what it does not know."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import transformers
from tiny_families import pictures

import dfd.common.threads
from dfd import _core, reference
from dfd.encoders import precision
from dfd.encoders.encode import load_encoder
from dfd.encoders.identity import find_identity, loaded_identity
from dfd.encoders.on_kernels import KernelNetwork, kernel_network
from dfd.encoders.on_torch import TorchNetwork
from dfd.encoders.sources import find_weights

pytestmark = pytest.mark.skipif(_core.instruction_set() == "baseline", reason="torch knows such processors better")

SIZES: dict[str, Any] = {
    "hidden_size": 128,
    "num_hidden_layers": 3,
    "num_attention_heads": 2,
    "mlp_ratio": 2,
    "image_size": 40,
    "patch_size": 8,
}
NAMES = ("project", "mix", "widen", "narrow")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small DINOv2 of widths that the kernels take, with nothing in it at 0 or 1, where mistakes would not show."""
    torch.manual_seed(3)
    model = transformers.Dinov2Model(transformers.Dinov2Config(**SIZES))
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(torch.randn_like(parameter) * 0.1)
    saved = tmp_path_factory.mktemp("widths") / "small"
    model.save_pretrained(saved)
    return saved


def networks(folder: Path, block: int, *, background: bool = False) -> tuple[KernelNetwork, TorchNetwork]:
    weights = find_weights(folder)
    ours = kernel_network(weights, block, None, background=background)
    assert ours is not None
    cpu = torch.device("cpu")
    return ours, TorchNetwork(weights, block, None, background=background, device=cpu, precision="float32")


@pytest.mark.parametrize("size", [40, 24, 64])
@pytest.mark.parametrize("block", [1, 3])
def test_tokens_are_those_of_transformers(folder: Path, size: int, block: int) -> None:
    ours, torchs = networks(folder, block)
    for name in ("patch", "step", "fixed_size", "block", "depth", "dimension", "channels", "takes_patches"):
        assert getattr(ours, name) == getattr(torchs, name)
    images = pictures(2, size)
    before = images.copy()
    covered = np.zeros(images.shape[:3], bool)
    covered[0, 3:20, 5:9] = True
    for shown in (None, covered):
        wanted = torchs.tokens(images, shown)
        found = ours.tokens(images, shown)
        np.testing.assert_allclose(found, wanted, atol=2e-5 * np.abs(wanted).max())
        np.testing.assert_array_equal(found == 0, wanted == 0)
    np.testing.assert_array_equal(images, before)


def test_an_encoder_takes_the_kernels_and_threads_do_not_show(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    encoder = load_encoder(folder, device="cpu", precision="float32")
    assert isinstance(encoder._network, KernelNetwork)
    images = pictures(5, 40)
    several = encoder.encode(images)
    monkeypatch.setattr(dfd.common.threads, "_threads", 1)
    np.testing.assert_array_equal(encoder.encode(images), several)
    assert isinstance(load_encoder(folder, device="cpu", precision="bfloat16")._network, TorchNetwork)


def test_a_network_with_its_background_looks_at_all_of_it(folder: Path) -> None:
    ours, _ = networks(folder, 3, background=True)
    images = pictures(1, 40)
    np.testing.assert_array_equal(ours.tokens(images, np.zeros((1, 40, 40), bool)), ours.tokens(images, None))


@pytest.mark.parametrize(
    "odd",
    [
        {"hidden_act": "relu"},
        {"num_attention_heads": 4},
        {"use_swiglu_ffn": True},
        {"num_hidden_layers": 4},
        {"model_type": "dinov2_with_registers"},
        {"image_size": 48},
    ],
)
def test_what_is_not_known_is_left_to_torch(folder: Path, tmp_path: Path, odd: dict[str, Any]) -> None:
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    config = json.loads((folder / "config.json").read_text()) | odd
    (tmp_path / "config.json").write_text(json.dumps(config))
    assert kernel_network(find_weights(tmp_path), None, None, background=False) is None


@pytest.mark.parametrize("block", [0, 4, True, "two"])
def test_a_block_that_is_none_is_left_to_torch(folder: Path, block: Any) -> None:
    assert kernel_network(find_weights(folder), block, None, background=False) is None


def test_a_shape_is_distilled_without_torch(folder: Path) -> None:
    code = (
        "import sys\nimport dfd\nfrom dfd.encoders.encode import load_encoder\n"
        f"encoder = load_encoder({str(folder)!r}, device='cpu', precision='float32')\n"
        "mesh = dfd.samples.chair(4000).mesh\n"
        "field = dfd.distill(mesh, encoder, views=4, resolution=40, steps=20, progress=False, cache=False)\n"
        "assert field(mesh.vertices).shape == (len(mesh.vertices), 128)\n"
        "print(sorted({'torch', 'transformers'} & sys.modules.keys()))"
    )
    asked = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert asked.stdout.strip() == "[]"


@pytest.mark.parametrize(("flags", "by_kernels"), [("avx2", True), ("avx2 amx_bf16", False)])
def test_where_the_kernels_are_fastest_nothing_is_timed(
    folder: Path, monkeypatch: pytest.MonkeyPatch, flags: str, by_kernels: bool
) -> None:
    monkeypatch.setattr(precision, "_cpu_lines", lambda: [f"flags : {flags}"])
    monkeypatch.setattr(precision, "cpu_has", lambda feature: True)
    monkeypatch.setattr(precision, "_bfloat16_pays", lambda: True)
    assert find_identity(folder, "cpu") is None
    encoder = load_encoder(folder, device="cpu")
    assert isinstance(encoder._network, KernelNetwork) is by_kernels
    assert encoder.precision == ("float32" if by_kernels else "bfloat16")
    known = find_identity(folder, "cpu")
    assert known is not None
    assert known["encoder_precision"] == encoder.precision
    assert loaded_identity(folder, "cpu", encoder) == known


def test_a_first_run_on_a_machine_takes_no_torch(folder: Path) -> None:
    if not precision.kernels_are_fastest():
        pytest.skip("this processor's bfloat16 is timed, by torch")
    code = (
        "import sys\nfrom dfd.encoders.encode import load_encoder\n"
        f"print(load_encoder({str(folder)!r}, device='cpu').precision, 'torch' in sys.modules)"
    )
    asked = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert asked.stdout.split() == ["float32", "False"]


def random_blocks(width: int, hidden: int, count: int) -> list[dict[str, np.ndarray]]:
    random = np.random.default_rng(5)
    shapes = {"project": (3 * width, width), "mix": (width, width), "widen": (hidden, width), "narrow": (width, hidden)}
    shapes |= {f"{name}_bias": shapes[name][:1] for name in NAMES}
    shapes |= dict.fromkeys(("gain_1", "shift_1", "gain_2", "shift_2"), (width,))
    return [
        {name: random.normal(scale=0.2, size=shape).astype(np.float32) for name, shape in shapes.items()}
        for _ in range(count)
    ]


def packed(blocks: list[dict[str, np.ndarray]], ends: list[np.ndarray], heads: int) -> _core.Transformer:
    vectors = [*(f"{name}_bias" for name in NAMES), "gain_1", "shift_1", "gain_2", "shift_2"]
    return _core.Transformer(
        [block[name] for block in blocks for name in NAMES],
        [*(block[name] for block in blocks for name in vectors), *ends],
        heads,
        1e-6,
    )


@pytest.mark.parametrize("count", [0, 1, 5, 64, 131])
def test_the_kernel_agrees_with_its_twin(count: int) -> None:
    blocks = random_blocks(128, 192, 2)
    ends = [np.linspace(0.5, 1, 128, dtype=np.float32), np.linspace(-1, 1, 128, dtype=np.float32)]
    tokens = np.random.default_rng(count).normal(size=(count, 128)).astype(np.float32)
    found = np.empty_like(tokens)
    packed(blocks, ends, 2).run(tokens, found)
    if count:
        exact = [{name: values.astype(np.float64) for name, values in block.items()} for block in blocks]
        wanted = reference.transformer(tokens, exact, *ends, heads=2)
        np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())


def test_shapes_that_do_not_fit_are_refused() -> None:
    blocks, ends = random_blocks(128, 192, 1), [np.ones(128, np.float32)] * 2
    tokens = np.zeros((3, 128), np.float32)
    with pytest.raises(ValueError, match="must have shape"):
        packed(blocks, ends, 2).run(tokens, np.zeros((2, 128), np.float32))
    with pytest.raises(ValueError, match="4 matrices and 8 vectors a block"):
        _core.Transformer([tokens], ends, 2, 1e-6)
    with pytest.raises(ValueError, match="at least one block, and one head"):
        _core.Transformer([], ends, 2, 1e-6)
    with pytest.raises(ValueError, match="multiples of what the kernels take together"):
        packed(blocks, ends, 3)
    with pytest.raises(ValueError, match="a matrix has another shape"):
        packed([blocks[0] | {"mix": tokens}], ends, 2)
    with pytest.raises(ValueError, match="a vector has another length"):
        packed([blocks[0] | {"gain_2": ends[0][:5]}], ends, 2)
