"""The two sets of defaults: dfd's own, and the paper's settings to the letter."""

from typing import Literal

Preset = Literal["default", "paper"]
