"""A warning from deep within points at the line that called the package."""

from __future__ import annotations

from contextlib import contextmanager
from types import ModuleType

import pytest

from dfd.common.check import warn


def test_it_points_at_the_caller() -> None:
    inside = ModuleType("dfd.inside")
    inside.__dict__.update(warn=warn, contextmanager=contextmanager)
    code = "@contextmanager\ndef deep():\n    warn('mind', UserWarning)\n    yield\ndef call():\n    with deep(): pass"
    exec(code, inside.__dict__)
    with pytest.warns(UserWarning, match="mind") as given:
        inside.call()
    assert given[0].filename == __file__
