"""A warning from deep within points at the line that called the package."""

from __future__ import annotations

import threading
import warnings
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


def test_a_thread_of_its_own_has_no_caller() -> None:
    thread = threading.Thread(target=warn, args=("mind", UserWarning))
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        thread.start()
        thread.join(60)
    assert [str(warning.message) for warning in given] == ["mind"]
