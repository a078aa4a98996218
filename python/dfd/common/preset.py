"""Name the two sets of defaults: dfd's own, and the exact settings of the paper."""

from typing import Literal

Preset = Literal["default", "paper"]
