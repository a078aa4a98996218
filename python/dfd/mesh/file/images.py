"""The images of one file, each opened and decoded once, within a common budget of texels."""

from __future__ import annotations

import hashlib
import io
import warnings
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import UInt8

if TYPE_CHECKING:
    from PIL import Image

MOST_TEXELS = 2**26  # of all decoded pictures of a file: 256 MiB as RGBA, four of 4096 × 4096


class ImageCache:
    """Opens images, and decodes those whose texels are requested.

    Equal bytes are one image. Its size is read from its first bytes, so an image beyond the budget is refused before
    it is decoded.
    """

    def __init__(self) -> None:
        self._opened: dict[str, Image.Image] = {}
        self._data: dict[int, bytes] = {}  # what each opened picture was made from, by its id
        self._texels: dict[int, UInt8] = {}
        self._left = MOST_TEXELS

    def open(self, data: bytes) -> Image.Image:
        """Return the picture in `data`, undecoded.

        Raises ValueError if it is not a picture, or larger than what is left of the budget.
        """
        key = hashlib.sha256(data).hexdigest()
        if key not in self._opened:
            image = self._opened[key] = _verified(data)
            self._data[id(image)] = data
        return self._opened[key]

    def texels(self, image: Image.Image) -> UInt8:
        """Return a picture that `open` gave as RGBA (rows, columns, 4), the first row on top.

        Raises ValueError if it cannot be decoded, or is larger than what is left of the budget.
        """
        if id(image) not in self._texels:
            self._spend(*image.size)
            # another instance of it: the opened one would keep a second copy of every texel
            self._texels[id(image)] = _decoded(self._data[id(image)])
        return self._texels[id(image)]

    def _spend(self, width: int, height: int) -> None:
        if width * height > self._left:
            raise ValueError(
                f"a picture of {width} × {height} texels exceeds what is left of the {MOST_TEXELS} of a file"
            )
        self._left -= width * height


def as_image(texels: UInt8, *, opaque: bool = False) -> Image.Image:
    """Return RGBA texels (rows, columns, 4) as an image, without alpha where all is opaque or `opaque` is set."""
    from PIL import Image

    opaque = opaque or bool((texels[..., 3] == 255).all())
    return Image.fromarray(np.ascontiguousarray(texels[..., :3]) if opaque else texels)


def as_png(texels: UInt8, *, opaque: bool = False) -> bytes:
    """Return `as_image` as a PNG file."""
    stream = io.BytesIO()
    as_image(texels, opaque=opaque).save(stream, "PNG")
    return stream.getvalue()


def _verified(data: bytes) -> Image.Image:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Pillow's own limit; ours is the budget
            with Image.open(io.BytesIO(data)) as image:
                image.verify()  # cheap; damage that only decoding finds is reported then
            return Image.open(io.BytesIO(data))
    except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError and more on damaged pictures
        raise ValueError(f"it is not a picture that can be read ({type(error).__name__})") from error


def _decoded(data: bytes) -> UInt8:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data)) as image:
                return np.asarray(image.convert("RGBA"), np.uint8)
    except Exception as error:
        raise ValueError(f"it cannot be decoded ({type(error).__name__})") from error
