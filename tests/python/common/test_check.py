"""Tests of `check.choice`, and of `check.warn`, whose warnings point at the caller of `dfd`."""

from contextlib import contextmanager
from types import ModuleType
from typing import Literal

import numpy as np
import pytest

from dfd.common import check

Side = Literal["left", "right"]


@pytest.mark.parametrize("value", ["up", "", None, 1, ["left"], np.array(["left", "right"])])
def test_values_that_are_no_option_are_refused(value):
    with pytest.raises(ValueError, match="turn: `side` must be one of left, right, got "):
        check.choice("turn", "side", value, Side)


def test_a_warning_from_nested_calls_points_at_the_caller():
    inside = ModuleType("dfd.inside")
    inside.__dict__.update(warn=check.warn, contextmanager=contextmanager)
    code = "@contextmanager\ndef deep():\n    warn('mind', UserWarning)\n    yield\ndef call():\n    with deep(): pass"
    exec(code, inside.__dict__)
    with pytest.warns(UserWarning, match="mind") as given:
        inside.call()
    assert given[0].filename == __file__
