"""Where the cache lies."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from dfd.common.files import cache_directory


def test_the_environment_names_the_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    assert cache_directory() == tmp_path / "cache"
    monkeypatch.setenv("DFD_CACHE", "~/somewhere")
    assert cache_directory() == Path.home() / "somewhere"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other platforms have other habits")
def test_otherwise_it_follows_the_platform(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("DFD_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_directory() == tmp_path / "dfd"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_directory() == Path.home() / ".cache" / "dfd"
