"""Words out of a few: taken, or refused by name."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest

from dfd.common import check

Side = Literal["left", "right"]


def test_a_word_of_the_type_is_taken() -> None:
    assert check.choice("turn", "side", "left", Side) == "left"


@pytest.mark.parametrize("value", ["up", "", None, 1, ["left"], np.array(["left", "right"])])
def test_anything_else_is_refused(value: Any) -> None:
    with pytest.raises(ValueError, match="turn: `side` must be one of left, right, got "):
        check.choice("turn", "side", value, Side)
