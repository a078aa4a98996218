"""The two sets of defaults: dfd's own, and the paper's settings to the letter."""

from typing import Literal

__all__ = ["Preset"]

Preset = Literal["default", "paper"]
