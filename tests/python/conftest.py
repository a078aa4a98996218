"""What several test files set up alike."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

import dfd


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Nothing of the user's cache is read or written, in children neither."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DFD_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def one_thread() -> Iterator[None]:
    """One thread for torch: networks as small as those of the tests only wait for one another's threads."""
    threads, own = torch.get_num_threads(), dfd.get_num_threads()
    torch.set_num_threads(1)
    dfd.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
    dfd.set_num_threads(own)
