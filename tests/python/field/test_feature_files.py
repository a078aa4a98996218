"""Files of features of another network: read whole or refused, also while somebody writes them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
import torch

from dfd.field.given_features import read_features


@pytest.mark.parametrize("shape", [(10**10, 2400), (1000, 384), (-1, 4)])
def test_a_header_that_promises_more_than_there_is_is_refused(shape: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / "features.npy"
    with path.open("wb") as stream:
        np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
        stream.write(bytes(100))
    with pytest.raises(ValueError, match=r"^`features` must be an .npy file of numbers, but .*features.npy is not: "):
        read_features(path, "`features`")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: torch.zeros(1).expand(10**9, 384),
            r"holds in full, but .* of \d+ bytes expands to 1536000000000 bytes",
        ),
        (lambda: torch.zeros(4, 8, device="meta"), "plain numbers, but .* holds a .* on meta"),
        (lambda: torch.nested.nested_tensor([torch.zeros(2), torch.zeros(3)]), "plain numbers, but .* nested tensor"),
        (lambda: torch.zeros(4, 8).to_sparse(), "plain numbers, but .* holds a torch.sparse"),
        (lambda: torch.zeros(4, 8, dtype=torch.complex64), "plain numbers, but "),
        (lambda: [torch.zeros(4, 8)], "one tensor, but .* holds a list"),
    ],
)
@pytest.mark.filterwarnings("ignore:The PyTorch API of nested tensors")
def test_a_tensor_that_is_not_all_in_its_file_is_refused(make: Callable[[], object], said: str, tmp_path: Path) -> None:
    path = tmp_path / "features.pt"
    torch.save(make(), path)
    with pytest.raises(ValueError, match=said):
        read_features(path, "`features`")


def test_a_compressed_archive_is_refused_before_it_grows(tmp_path: Path) -> None:
    path, small = tmp_path / "large.pt", tmp_path / "features.pt"
    torch.save(torch.zeros(1000, 384), path)
    with ZipFile(path) as archive, ZipFile(small, "w", ZIP_DEFLATED) as deflated:
        for entry in archive.infolist():
            deflated.writestr(entry.filename, archive.read(entry))
    with pytest.raises(ValueError, match="its archive is compressed"):
        read_features(small, "`features`")
