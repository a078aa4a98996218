"""The loss of every step of a fit, drawn with nothing but Pillow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from dfd.common.files import atomic_write

SIZE = (960, 600)
LEFT, TOP, RIGHT, BOTTOM = 90, 40, 30, 60


def save_loss_curve(path: Path, losses: Sequence[float]) -> None:
    """Draw `losses`, one a step, on a logarithmic axis as a PNG file.

    Raises ValueError if there is no loss to draw, or one that a logarithm does not take; OSError if `path` cannot be
    written.
    """
    if not losses or not all(math.isfinite(loss) and loss > 0 for loss in losses):
        raise ValueError("save_loss_curve: `losses` must be positive numbers, at least one")
    image = Image.new("RGB", SIZE, "white")
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(16)
    width, height = SIZE[0] - LEFT - RIGHT, SIZE[1] - TOP - BOTTOM
    # Whole steps of 1, 2 and 5 around the losses, so that the axis has round numbers at both ends.
    levels = [digit * 10.0**power for power in range(-12, 13) for digit in (1, 2, 5)]
    low = max((level for level in levels if level <= min(losses)), default=levels[0])
    high = min((level for level in levels if level >= max(losses) and level > low), default=levels[-1])

    def x(step: int) -> float:
        return LEFT + width * step / max(len(losses) - 1, 1)

    def y(loss: float) -> float:
        return TOP + height * (1.0 - math.log(loss / low) / math.log(high / low))

    for level in (level for level in levels if low <= level <= high):
        draw.line([(LEFT, y(level)), (LEFT + width, y(level))], fill="#dddddd")
        draw.text((LEFT - 10, y(level)), f"{level:g}", fill="#444444", font=font, anchor="rm")
    for part in range(5):
        step = round(part / 4 * (len(losses) - 1))
        draw.text((x(step), TOP + height + 10), str(step + 1), fill="#444444", font=font, anchor="mt")
    draw.text((LEFT + width / 2, SIZE[1] - 12), "step", fill="#444444", font=font, anchor="mb")
    draw.text((LEFT, TOP - 14), f"loss (Eq. 3), {losses[-1]:.4g} at the end", fill="#444444", font=font, anchor="lb")
    points = [(x(step), y(loss)) for step, loss in enumerate(losses)]
    draw.line(points if len(points) > 1 else points * 2, fill="#2a6fb0", width=2)
    with atomic_write(path, "--loss-curve") as temporary:
        image.save(temporary, format="PNG")
