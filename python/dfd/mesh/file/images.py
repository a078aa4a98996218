"""Decoding of the images of one file, each once, within a common limit on texels."""

from __future__ import annotations

import hashlib
import io
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from dfd.common.linear_algebra import UInt8

if TYPE_CHECKING:
    from PIL import Image

_T = TypeVar("_T")
MOST_TEXELS = 2**26  # of all decoded pictures of a file: 256 MiB as RGBA, four of 4096 × 4096


class ImageCache:
    """Decodes images; equal bytes are decoded once.

    The size of an image comes from its first bytes, so an image beyond the limit is refused before it is decoded.
    """

    def __init__(self) -> None:
        self._texels: dict[str, UInt8] = {}
        self._left = MOST_TEXELS

    def texels(self, data: bytes) -> UInt8:
        """Return an image as RGBA (rows, columns, 4), the first row on top.

        Raises ValueError if the image cannot be decoded, or has more texels than the limit still allows.
        """
        key = hashlib.sha256(data).hexdigest()
        if key not in self._texels:
            width, height = _read(data, lambda image: image.size)
            if width * height > self._left:
                raise ValueError(
                    f"a picture of {width} × {height} texels exceeds what is left of the {MOST_TEXELS} of a file"
                )
            self._left -= width * height
            self._texels[key] = _read(data, lambda image: np.asarray(image.convert("RGBA"), np.uint8))
        return self._texels[key]


def image_format(data: bytes) -> str:
    """Return the format of an image in lower case; raise ValueError if `data` is not an image."""

    def verified(image: Image.Image) -> str:
        image.verify()  # cheap; later decoding reports other damage
        return (image.format or "png").lower()

    return _read(data, verified)


def as_image(texels: UInt8, *, opaque: bool = False) -> Image.Image:
    """Return RGBA texels (rows, columns, 4) as an image, without alpha if all are opaque or `opaque` is set."""
    from PIL import Image

    opaque = opaque or bool((texels[..., 3] == 255).all())
    return Image.fromarray(np.ascontiguousarray(texels[..., :3]) if opaque else texels)


def as_png(texels: UInt8, *, opaque: bool = False) -> bytes:
    """Return `as_image` as a PNG file."""
    stream = io.BytesIO()
    as_image(texels, opaque=opaque).save(stream, "PNG")
    return stream.getvalue()


def _read(data: bytes, use: Callable[[Image.Image], _T]) -> _T:
    """Return the result of `use` for an opened image."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about Pillow's own size limit; MOST_TEXELS applies instead
            with Image.open(io.BytesIO(data)) as image:
                return use(image)
    except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError and more on damaged pictures
        raise ValueError(f"it is not a picture that can be read ({type(error).__name__})") from error
