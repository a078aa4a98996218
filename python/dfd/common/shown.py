"""Show objects as pictures in notebooks."""

from collections.abc import Callable
from typing import Any


class Shown:
    """Base class of objects that a notebook shows as pictures.

    Pictures are drawn by a later package, so `dfd` sets `draw`, which returns the bytes of a PNG file.
    """

    __slots__ = ()
    draw: Callable[[Any], bytes]

    def _repr_png_(self) -> bytes:
        """Return the picture that `dfd.show` makes; called by notebooks."""
        return Shown.draw(self)
