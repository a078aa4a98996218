"""Captioned pictures on one page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from dfd.common import check
from dfd.common.linear_algebra import UInt8
from dfd.pictures.colors import weight_colors
from dfd.pictures.labels import font, wrapped

Rows = Sequence[tuple[str, Sequence[tuple[UInt8, str]]]]  # a heading, and pictures with their captions
Box = tuple[int, int, int, int]  # left, top, width, height, pixels

INK, GRAY, RULE = (28, 30, 36), (100, 104, 112), (220, 222, 226)
SMALLEST_CELL, LARGEST_CELL = 16, 8192
NARROWEST = 96  # pixels that a heading may use however narrow the rows are


def contact_sheet(rows: Rows, *, title: str = "", cell: int = 320) -> Image.Image:
    """Set pictures in rows on a white page, below a `title` that may be empty.

    `rows` are headings with pictures, uint8 arrays of shape (height, width, 3), and the caption below each; headings
    and captions may be empty, and rows without pictures are left out. `cell` is the height that every picture gets,
    pixels; text and margins follow it.

    Raises ValueError if there is no picture, a picture has another type or shape, or `cell` is out of its range.
    """
    return lay_out(rows, title=title, cell=cell)[0]


def lay_out(rows: Rows, *, title: str = "", cell: int = 320) -> tuple[Image.Image, list[list[Box]]]:
    """As `contact_sheet`, and where on the page the pictures are: a list for each row that has pictures."""
    cell = check.whole("contact_sheet", "cell", cell, minimum=SMALLEST_CELL, maximum=LARGEST_CELL)
    scaled = [
        (heading, [(_scaled(picture, cell), caption) for picture, caption in pictures])
        for heading, pictures in rows
        if pictures
    ]
    if not scaled:
        raise ValueError("contact_sheet: `rows` must hold at least one picture, got none")
    margin, gap, between = max(8, cell // 8), max(4, cell // 18), max(8, cell // 7)
    widths = [sum(image.width + gap for image, _ in pictures) - gap for _, pictures in scaled]
    width = max(NARROWEST, *widths)
    blocks: list[tuple[Image.Image, list[Box]]] = []
    if title:
        blocks.append((_heading(title, width, max(12, cell // 9), INK), []))
    blocks += [_row(heading, pictures, width, gap, cell) for heading, pictures in scaled]
    boxes: list[list[Box]] = []
    height = sum(block.height for block, _ in blocks) + between * (len(blocks) - 1)
    page = Image.new("RGB", (width + 2 * margin, height + 2 * margin), "white")
    draw = ImageDraw.Draw(page)
    top = margin
    for index, (block, places) in enumerate(blocks):
        if index:
            line = top - between // 2
            draw.line([(margin, line), (margin + width, line)], fill=RULE, width=max(1, cell // 320))
        page.paste(block, (margin, top))
        if places:
            boxes.append([(margin + x, top + y, wide, high) for x, y, wide, high in places])
        top += block.height + between
    return page, boxes


def heat_bar(height: int) -> UInt8:
    """Draw the scale of the heat colors, (height, width, 3): weight 0 at the bottom, 1 at the top."""
    size = max(9, height // 22)
    typeface = font(size)
    long, thick = int(height * 0.6), max(4, height // 26)
    width = max(thick + 2 * size + max(4, size // 2), int(typeface.getlength("weight")) + 2)
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


def with_heat_bar(picture: UInt8) -> UInt8:
    """A picture (height, width, 3) with the scale of the heat colors at its right."""
    bar = heat_bar(len(picture))
    return np.concatenate([picture, bar, np.full((len(bar), max(4, len(bar) // 40), 3), 255, np.uint8)], axis=1)


def _row(
    heading: str, pictures: list[tuple[Image.Image, str]], width: int, gap: int, cell: int
) -> tuple[Image.Image, list[Box]]:
    """Draw one heading and its pictures side by side, each with its caption below it; and say where they are."""
    size = max(9, cell // 19)
    head = _heading(heading, width, max(10, cell // 14), INK)
    captions = [wrapped(caption, font(size), image.width) for image, caption in pictures]
    line, lines = int(size * 1.4), max(len(each) for each in captions)
    start = head.height + (cell // 32 if heading else 0)
    row = Image.new("RGB", (width, start + cell + (size // 2 + line * lines if lines else 0)), "white")
    row.paste(head, (0, 0))
    draw = ImageDraw.Draw(row)
    left = 0
    boxes = []
    for (image, _), text in zip(pictures, captions, strict=True):
        row.paste(image, (left, start))
        boxes.append((left, start, image.width, cell))
        for index, words in enumerate(text):
            corner = (left + image.width / 2, start + cell + size // 2 + index * line)
            draw.text(corner, words, GRAY, font(size), anchor="ma")
        left += image.width + gap
    return row, boxes


def _heading(text: str, width: int, size: int, ink: tuple[int, int, int]) -> Image.Image:
    lines = wrapped(text, font(size), width) if text else []
    block = Image.new("RGB", (width, int(size * 1.3) * len(lines)), "white")
    draw = ImageDraw.Draw(block)
    for index, words in enumerate(lines):
        draw.text((0, index * int(size * 1.3)), words, ink, font(size))
    return block


def _scaled(picture: UInt8, cell: int) -> Image.Image:
    values = np.asarray(picture)
    if values.dtype != np.uint8 or values.ndim != 3 or values.shape[2] != 3 or values.size == 0:
        raise ValueError(
            "contact_sheet: a picture must be a uint8 array of shape (height, width, 3), "
            f"got {values.dtype} of shape {values.shape}"
        )
    image = Image.fromarray(np.ascontiguousarray(values))
    width = max(1, round(image.width * cell / image.height))
    return image if image.size == (width, cell) else image.resize((width, cell), Image.Resampling.LANCZOS)
