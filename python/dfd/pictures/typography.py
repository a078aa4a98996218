"""Text for pictures in the one typeface that Pillow carries."""

from __future__ import annotations

import unicodedata
from functools import lru_cache

from PIL import ImageFont

__all__ = ["font", "spelled", "wrapped"]

# What the typeface lacks, in letters that it has.
_SPELLED = {
    "λ": "lambda", "ε": "epsilon", "μ": "u", "µ": "u", "Φ": "Phi", "Σ": "sum", "Δ": "delta", "π": "pi", "σ": "sigma",
    "→": "->", "←": "<-", "×": "x", "−": "-", "–": "-", "—": "-", "≥": ">=", "≤": "<=", "≠": "!=", "≈": "~",
    "∞": "infinity", "•": "·", "‖": "||", "√": "sqrt", "ß": "ss", "ø": "o", "Ø": "O", "æ": "ae", "Æ": "AE", "ł": "l",
}  # fmt: skip


@lru_cache(maxsize=32)
def font(size: int) -> ImageFont.FreeTypeFont:
    """Pillow's own typeface, `size` pixels high.

    Raises
    ------
    RuntimeError
        If Pillow was built without FreeType, which none of its wheels is.
    """
    loaded = ImageFont.load_default(size)
    if not isinstance(loaded, ImageFont.FreeTypeFont):
        raise RuntimeError("pictures with text need a Pillow that was built with FreeType")
    return loaded


def spelled(text: str) -> str:
    """Return `text` with what the typeface lacks spelled in other letters, or as a question mark."""
    return "".join(_letter(letter) for letter in text)


def wrapped(text: str, typeface: ImageFont.FreeTypeFont, room: float) -> list[str]:
    """Lines of `text`, spelled, no wider than `room` pixels: broken at spaces, a longer word alone on its line."""
    lines: list[str] = []
    for word in spelled(text).split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and typeface.getlength(longer) <= room:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


@lru_cache(maxsize=1024)
def _letter(letter: str) -> str:
    if letter.isspace() or _drawable(letter):
        return letter
    plain = _SPELLED.get(letter) or "".join(
        part for part in unicodedata.normalize("NFKD", letter) if not unicodedata.combining(part)
    )
    plain = plain.replace("⁄", "/").replace("−", "-")
    return plain if plain and all(_drawable(part) for part in plain) else "?"


def _drawable(letter: str) -> bool:
    """Whether the typeface has the letter, rather than the box that stands for what it lacks."""
    typeface = font(20)
    mask, lacking = typeface.getmask(letter), typeface.getmask("\uffff")
    return mask.size != lacking.size or bytes(mask) != bytes(lacking)
