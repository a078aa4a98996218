"""Test the variant of the preset "paper" with mirrored pictures: it causes no warning, and an error advises it."""

from __future__ import annotations

import warnings

import pytest
from made_field import field_of

import dfd
from dfd.distillation.settings import DistillSettings


def session(mirrored: bool, preset: str = "paper", **other: object) -> dfd.Deformer:
    mesh = dfd.samples.chair(4_000).mesh
    settings = {**DistillSettings(preset="paper", mirrored=mirrored).as_dict(), **other}
    return dfd.Deformer(mesh, field_of(mesh).with_settings(settings), preset=preset)


@pytest.mark.parametrize("mirrored", [False, True])
def test_both_variants_are_the_preset(mirrored):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        session(mirrored)
    with pytest.warns(UserWarning, match="other settings: octaves"):
        session(mirrored, octaves=5)


@pytest.mark.parametrize(
    ("mirrored", "preset", "advised"), [(False, "paper", True), (True, "paper", False), (False, "default", False)]
)
def test_an_error_advises_mirrored_pictures_where_they_help(mirrored, preset, advised):
    with pytest.raises(ValueError, match="no plane has two sides that look alike") as raised:
        session(mirrored, preset).set_symmetry("auto", threshold=0.0)
    assert ("mirrored=True" in str(raised.value)) == advised
