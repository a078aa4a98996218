"""The number of threads, as it was before each test."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import dfd


@pytest.fixture(autouse=True)
def _restore_thread_count() -> Iterator[None]:
    before = dfd.get_num_threads()
    yield
    dfd.set_num_threads(before)
