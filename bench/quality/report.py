"""The table of results: as CSV for programs, and as Markdown for people, with what it shows in words."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from rich.console import Console

from bench.quality.studies import BARYCENTRIC, GRAY, PLAIN, TEXTURED, VERTEX, Row
from bench.tables import to_csv, to_markdown

MEASURES = ("precision", "precision ±", "ratio", "moving", "symmetry error", "Dirichlet energy", "off the first")
LEGEND = {
    "precision": "mean average precision, over parts, with which a handle's weights rank its own kind of part first",
    "precision ±": "its standard deviation over the seeds of the fit",
    "ratio": "mean weight of the same kind of part over mean weight of the rest, median over handles",
    "moving": "share of the vertices with a weight above 0.01",
    "symmetry error": "mean of |W(i, j) − W(mirror i, mirror j)| over the mean weight, where a shape mirrors itself",
    "Dirichlet energy": "∫ ‖∇w‖² over the full mesh, mean over handles; less is smoother",
    "off the first": "mean of |W − W'| over the mean of W', the weights of the group's first row",
    "plain": "with neither mirrored views nor smoothing: the paper's own loss",
    "gray": "pictures taken without the file's colors and textures",
}

# By study: a setting, the one it is held against, and by which measures.
COMPARISONS: Mapping[str, Sequence[tuple[str, str, Sequence[str]]]] = {
    "supervision": (
        (BARYCENTRIC, VERTEX, ("Dirichlet energy", "precision")),
        (PLAIN, VERTEX, ("Dirichlet energy", "precision")),
        (BARYCENTRIC, PLAIN, ("symmetry error",)),
    ),
    "textures": ((GRAY, TEXTURED, ("precision", "Dirichlet energy")),),
}
# Of which less is better, and what a weight that has less or more of it is called.
LESS_IS_BETTER = {"Dirichlet energy": ("smoother", "rougher"), "symmetry error": ("more symmetric", "less symmetric")}


def timed() -> Callable[[str], None]:
    """A function that prints what goes on to standard error, with the seconds since now."""
    console, start = Console(stderr=True, highlight=False), time.perf_counter()
    return lambda text: console.print(f"[dim]{time.perf_counter() - start:5.0f} s[/dim]  {text}", soft_wrap=True)


def as_csv(rows: Sequence[Row]) -> str:
    """One line a row of results, one column a measure, empty where it does not apply."""
    cells = [[row.study, row.shape, row.setting, *map(row.verdict.get, MEASURES), row.note] for row in rows]
    return to_csv(["study", "shape", "setting", *MEASURES, "note"], cells)


def as_markdown(rows: Sequence[Row], heading: str) -> str:
    """A section and a table a study, with what it shows in words; columns are the measures that some row has."""
    lines = ["# Quality of the weights", "", heading, ""]
    for study in dict.fromkeys(row.study for row in rows):
        own = [row for row in rows if row.study == study]
        notes = ["note"] if any(row.note for row in own) else []
        measures = [measure for measure in MEASURES if any(measure in row.verdict for row in own)]
        cells = [[row.shape, row.setting, *map(row.verdict.get, measures), *[row.note for _ in notes]] for row in own]
        lines += [f"## {study.capitalize()}", "", *to_markdown(["shape", "setting", *measures, *notes], cells), ""]
        if said := in_words(own):
            lines += [*(f"- {sentence}" for sentence in said), ""]
    lines += ["## What the words mean", ""]
    lines += [f"- **{word}**: {meaning}." for word, meaning in LEGEND.items()]
    return "\n".join(lines) + "\n"


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
