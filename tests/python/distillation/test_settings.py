"""The settings of a distillation: one frozen object that checks itself."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from dfd.distillation.settings import DistillSettings


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"views": 0}, "`views` must be a whole number from 1 to 32767, got 0"),
        ({"views": 2.0}, "`views` must be a whole number, got 2.0"),
        ({"resolution": 4097}, "`resolution` must be a whole number from 1 to 4096, got 4097"),
        ({"framing": "close"}, "`framing` must be one of shape, paper, got 'close'"),
        ({"framing": ["shape"]}, r"`framing` must be one of shape, paper, got \['shape'\]"),
        ({"simplify_to": 3}, "`simplify_to` must be a whole number of at least 4, got 3"),
        ({"simplify_to": 1e3}, "`simplify_to` must be a whole number, got 1000.0"),
        ({"supervision": "pixel"}, "`supervision` must be one of barycentric, vertex, got 'pixel'"),
        ({"mirrored": "no"}, "`mirrored` must be True or False, got 'no'"),
        ({"smoothing": -0.1}, "`smoothing` must be at least 0, got -0.1"),
        ({"smoothing": float("nan")}, "`smoothing` must be finite, got nan"),
        ({"smoothing": 2.1}, "`smoothing` must be at most 2, got 2.1"),
        ({"metric": "mine"}, "`metric` must be one of learned, none, got 'mine'"),
        ({"octaves": 17}, "`octaves` must be a whole number from 0 to 16, got 17"),
        ({"steps": 0}, "`steps` must be a whole number of at least 1, got 0"),
        ({"batch": True}, "`batch` must be a whole number, got True"),
        ({"learning_rate": 0.0}, "`learning_rate` must be above 0, got 0"),
        ({"seed": -1}, "`seed` must be a whole number from 0 to 9223372036854775807, got -1"),
    ],
)
def test_each_one_is_named_when_it_is_out_of_range(setting: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^distill: {message}"):
        DistillSettings(**setting)


def test_they_do_not_change() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        DistillSettings().views = 3  # type: ignore[misc]


def test_numbers_of_numpy_are_pythons_and_equal_settings_are_equal() -> None:
    one = DistillSettings(views=np.int64(7), mirrored=np.False_, smoothing=np.float64(0.5), simplify_to=np.int32(9))
    assert one == DistillSettings(views=7, mirrored=False, smoothing=0.5, simplify_to=9)
    assert json.loads(json.dumps(one.as_dict())) == one.as_dict()


def test_the_ablation_is_never_smoothed() -> None:
    assert DistillSettings(supervision="vertex", smoothing=0.5).smoothing == 0


def test_every_setting_belongs_to_up_the_pictures_the_spreading_or_the_fit() -> None:
    settings = DistillSettings()
    assert {
        **settings.of_pictures(),
        "up": "auto",
        "smoothing": 0.3,
        "metric": "learned",
        **settings.of_fit(),
    } == settings.as_dict()
