"""Which regions follow a part. This module imports nothing heavy, because the command-line help needs it."""

from typing import Literal

Follow = Literal["all", "mirror", "none"]
