"""What a study's table shows, in words: the factors that a reader would otherwise work out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bench.quality.studies import BARYCENTRIC, GREY, PLAIN, TEXTURED, VERTEX, Row

# By study: a setting, the one it is held against, and by which measures.
COMPARISONS: Mapping[str, Sequence[tuple[str, str, Sequence[str]]]] = {
    "supervision": (
        (BARYCENTRIC, VERTEX, ("Dirichlet energy", "precision")),
        (PLAIN, VERTEX, ("Dirichlet energy", "precision")),
        (BARYCENTRIC, PLAIN, ("symmetry error",)),
    ),
    "textures": ((GREY, TEXTURED, ("precision", "Dirichlet energy")),),
}
# Of which less is better, and what a weight that has less or more of it is called.
LESS_IS_BETTER = {"Dirichlet energy": ("smoother", "rougher"), "symmetry error": ("more symmetric", "less symmetric")}


def in_words(rows: Sequence[Row]) -> list[str]:
    """Sentences on the `rows` of one study, shape by shape; none where they hold nothing to compare."""
    said = []
    for shape in dict.fromkeys(row.shape for row in rows):
        verdicts = {row.setting: row.verdict for row in rows if row.shape == shape}
        for setting, other, measures in COMPARISONS.get(rows[0].study, ()):
            one, two = verdicts.get(setting, {}), verdicts.get(other, {})
            both = [measure for measure in measures if measure in one and measure in two]
            told = [compared(measure, one[measure], two[measure]) for measure in both]
            if told:
                said.append(f"{shape}, {setting} against {other}: {', '.join(told)}.")
    return said


def compared(measure: str, value: float, other: float) -> str:
    """How a `value` of a measure compares with an `other` one: by a factor, or for shares by their difference."""
    if measure not in LESS_IS_BETTER:
        word = "more" if value >= other else "less"
        return f"{abs(value - other):.3f} {word} precise ({measure} {value:.3f} against {other:.3f})"
    better, worse = LESS_IS_BETTER[measure]
    low, high = sorted((value, other))
    factor = f"{high / low:.2f}" if low > 0 else "infinitely many"
    return f"{factor} times {better if value <= other else worse} ({measure} {value:.3g} against {other:.3g})"
