"""Arrange pictures with captions on one page."""

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from dfd.common import check
from dfd.common.linear_algebra import UInt8
from dfd.pictures.colors import weight_colors
from dfd.pictures.labels import font, wrapped

Rows = Sequence[tuple[str, Sequence[tuple[UInt8, str]]]]  # each row: a heading, and pictures with their captions

INK, GRAY, RULE = (28, 30, 36), (100, 104, 112), (220, 222, 226)
SMALLEST_CELL, LARGEST_CELL = 16, 8192  # bounds of the height of a picture, in pixels
NARROWEST = 96  # smallest width of the page without its margins, in pixels, so that headings fit


def contact_sheet(rows: Rows, *, title: str = "", cell: int = 320) -> Image.Image:
    """Return a white page with a `title` and rows of pictures.

    Each of `rows` has a heading and pictures with captions. A picture is a uint8 array of shape (height, width, 3).
    Title, headings and captions may be empty. Rows without pictures are left out. Pictures are scaled to the height
    `cell`, in pixels. Text and margins grow with `cell`.

    Raises ValueError if there is no picture, a picture has another dtype or array shape, or `cell` is not 16 to 8192.
    """
    cell = check.whole("contact_sheet", "cell", cell, minimum=SMALLEST_CELL, maximum=LARGEST_CELL)
    scaled = [
        (heading, [(_scaled(picture, cell), caption) for picture, caption in pictures])
        for heading, pictures in rows
        if pictures
    ]
    if not scaled:
        raise ValueError("contact_sheet: `rows` must have at least one picture, got none")
    margin, gap, between = max(8, cell // 8), max(4, cell // 18), max(8, cell // 7)
    widths = [sum(image.width + gap for image, _ in pictures) - gap for _, pictures in scaled]
    width = max(NARROWEST, *widths)
    blocks = [_text(title, width, max(12, cell // 9), INK)] if title else []
    blocks += [_row(heading, pictures, width, gap, cell) for heading, pictures in scaled]
    height = sum(block.height for block in blocks) + between * (len(blocks) - 1)
    page = Image.new("RGB", (width + 2 * margin, height + 2 * margin), "white")
    draw = ImageDraw.Draw(page)
    top = margin
    for index, block in enumerate(blocks):
        if index:
            line = top - between // 2
            draw.line([(margin, line), (margin + width, line)], fill=RULE, width=max(1, cell // 320))
        page.paste(block, (margin, top))
        top += block.height + between
    return page


def heat_bar(height: int) -> UInt8:
    """Return a picture (height, width, 3) of the heat map's legend, with weight 0 at the bottom and 1 at the top."""
    size = max(9, height // 22)
    typeface = font(size)
    long, thick = int(height * 0.6), max(4, height // 26)
    width = max(thick + 2 * size + max(4, size // 2), int(typeface.getlength("weight")) + size // 2)
    image = Image.new("RGB", (width, height), "white")
    draw = ImageDraw.Draw(image)
    top = (height - long) // 2
    ramp = (weight_colors(np.linspace(1, 0, long)) * 255 + 0.5).astype(np.uint8)
    image.paste(Image.fromarray(np.repeat(ramp[:, None], thick, axis=1)), (0, top))
    draw.text((0, top - size), "weight", GRAY, typeface, anchor="ls")
    for value in (0.0, 0.5, 1.0):
        at = top + (1 - value) * (long - 1)
        draw.text((thick + max(3, size // 2), at), f"{value:g}", GRAY, typeface, anchor="lm")
    return np.asarray(image)


def _row(heading: str, pictures: list[tuple[Image.Image, str]], width: int, gap: int, cell: int) -> Image.Image:
    """Return an image of a row: a heading, pictures side by side below it, and a caption below each picture."""
    head, size = _text(heading, width, max(10, cell // 14), INK), max(9, cell // 19)
    captions = [_text(caption, image.width, size, GRAY, centered=True) for image, caption in pictures]
    top = head.height + (cell // 32 if heading else 0)
    below = max(block.height for block in captions)
    row = Image.new("RGB", (width, top + cell + (size // 2 + below if below else 0)), "white")
    row.paste(head, (0, 0))
    left = 0
    for (image, _), caption in zip(pictures, captions, strict=True):
        row.paste(image, (left, top))
        row.paste(caption, (left, top + cell + size // 2))
        left += image.width + gap
    return row


def _text(text: str, width: int, size: int, ink: tuple[int, int, int], *, centered: bool = False) -> Image.Image:
    """Return an image of `text` on white, with letters `size` pixels high and lines of at most `width` pixels."""
    lines, line = wrapped(text, font(size), width), int(size * 1.35)
    block = Image.new("RGB", (width, line * len(lines)), "white")
    draw = ImageDraw.Draw(block)
    for index, words in enumerate(lines):
        corner = (width / 2 if centered else 0, index * line)
        draw.text(corner, words, ink, font(size), anchor="ma" if centered else "la")
    return block


def _scaled(picture: UInt8, cell: int) -> Image.Image:
    """Return `picture` as an image, scaled to the height `cell` in pixels."""
    values = np.asarray(picture)
    if values.dtype != np.uint8 or values.ndim != 3 or values.shape[2] != 3 or values.size == 0:
        found = f"{values.dtype} of shape {values.shape}"
        raise ValueError(f"contact_sheet: a picture must be uint8 of shape (height, width, 3), got {found}")
    image = Image.fromarray(np.ascontiguousarray(values))
    width = max(1, round(image.width * cell / image.height))
    return image if image.size == (width, cell) else image.resize((width, cell), Image.Resampling.LANCZOS)
