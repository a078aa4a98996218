"""The names of the two sets of default settings: dfd's own settings, and the exact settings of the paper."""

from typing import Literal

Preset = Literal["default", "paper"]
