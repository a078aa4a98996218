"""Where things that can be made again are kept between runs."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

__all__ = ["cache_directory"]


def cache_directory() -> Path:
    """Return the user's cache folder for `dfd`; it need not exist yet.

    The environment variable DFD_CACHE names it outright; otherwise it follows the habit of the platform, on Linux
    XDG_CACHE_HOME or ~/.cache.
    """
    named = os.environ.get("DFD_CACHE")
    return Path(named).expanduser() if named else platformdirs.user_cache_path("dfd", appauthor=False)
