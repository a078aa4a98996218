"""Fixtures that the tests of encoders share."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
import transformers
from huggingface_hub import constants
from tiny_encoder import save_tiny_encoder
from tiny_families import CASES, Saved


@pytest.fixture(autouse=True)
def _isolated(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Disable the network, and give each test empty caches."""
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    transformers.utils.logging.disable_progress_bar()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the folder of a tiny DINOv2 with random weights, which transformers saved."""
    return save_tiny_encoder(tmp_path / "tiny", seed=3)


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Saved]:
    """Return a function that gives a tiny model of a family with random weights, saved by transformers."""
    made: dict[str, Saved] = {}

    def get(name: str) -> Saved:
        if name not in made:
            torch.manual_seed(7)
            model = CASES[name].make().eval()
            with torch.no_grad():  # biases, norms and position tables start at 0 or 1, which would hide errors
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
