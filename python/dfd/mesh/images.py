"""Convert pictures with Pillow, which is imported when it is first needed."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from dfd.common.linear_algebra import UInt8

if TYPE_CHECKING:
    from PIL import Image

_T = TypeVar("_T")


def read_image(data: bytes, use: Callable[[Image.Image], _T]) -> _T:
    """Open an image file with Pillow, and return the result of `use(image)`."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns about its own size limit; the caller has its own
            with Image.open(io.BytesIO(data)) as image:
                return use(image)
    except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError and more for damaged images
        raise ValueError(f"it is not a readable image ({type(error).__name__})") from error


def image_format(data: bytes) -> str:
    """Return the format of an image in lower case; raise ValueError if `data` is not an image."""

    def verified(image: Image.Image) -> str:
        image.verify()
        return (image.format or "png").lower()

    return read_image(data, verified)


def as_texels(image: Image.Image) -> UInt8:
    """Return a Pillow image as RGBA texels (rows, columns, 4). Gray images of 16 or 32 bits are scaled to 8 bits."""
    from PIL import Image

    if image.mode in ("I", "F") or image.mode.startswith("I;16"):  # Pillow's own conversion would clip these to white
        white = 1.0 if image.mode == "F" else 65535.0
        gray = np.nan_to_num(np.asarray(image, np.float64) / white).clip(0, 1)
        image = Image.fromarray(np.rint(gray * 255).astype(np.uint8))
    return np.asarray(image.convert("RGBA"), np.uint8)


def as_image(texels: UInt8) -> Image.Image:
    """Return texels (rows, columns, 4) as a Pillow image, without the alpha channel if all texels are opaque."""
    from PIL import Image

    opaque = bool((texels[..., 3] == 255).all())
    return Image.fromarray(np.ascontiguousarray(texels[..., :3]) if opaque else texels)


def as_png(texels: UInt8) -> bytes:
    """Return texels (rows, columns, 4) as the bytes of a PNG file."""
    stream = io.BytesIO()
    as_image(texels).save(stream, "PNG")
    return stream.getvalue()
