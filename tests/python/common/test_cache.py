"""Where the cache lies."""

from __future__ import annotations

from pathlib import Path

import pytest

from dfd.common.files import cache_directory


def test_the_environment_names_the_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    assert cache_directory() == tmp_path / "cache"
    monkeypatch.setenv("DFD_CACHE", "~/somewhere")
    assert cache_directory() == Path.home() / "somewhere"
