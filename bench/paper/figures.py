"""The claims of all figures and tables of the paper and its supplement, and the numbers that decide them.

Where the paper has no number, the bound is ours, the least that its words need.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bench.paper import comparisons, controls, features, resolution
from bench.paper.page import Figure, Page, Row, Rule
from bench.paper.subjects import NAMES, Context

OURS = NAMES["paper"]


def column(name: str, reduce: Callable[[Any], Any] = np.mean, **where: Any) -> Rule:
    """Return the rule that reduces a column over the rows that have one of the given values in other columns."""

    def number(rows: Sequence[Row]) -> float:
        fitting = [row for row in rows if all(row.get(key) in np.atleast_1d(each) for key, each in where.items())]
        found = [row[name] for row in fitting if row.get(name) is not None]
        return float(reduce(found)) if found else float("nan")

    return number


def ratio(name: str, above: dict[str, Any], below: dict[str, Any]) -> Rule:
    """Return the rule for one mean over another."""
    return lambda rows: column(name, **above)(rows) / max(column(name, **below)(rows), 1e-9)


def spread(found: Any) -> float:
    """Return the largest over the smallest value."""
    return float(max(found) / max(min(found), 1e-9))


DFD = {"method": OURS}  # failures of DFD count; those of the others do not
# Results that explode have a note.
PEERS, COORDINATES = ({"method": each, "note": ""} for each in (comparisons.COMPARED, "biharmonic"))
FAILING = {"method": comparisons.COMPARED}
FREE, FIXED, FAR, WIDE = ({"preset": OURS, "variant": each} for each in ("free", "fixed", "λ = 32", "λ = 0"))
PIXELS, VERTICES = ({"variant": name} for name in ("paper preset, coarse copy, all pixels", features.VERTICES_ALONE))
PLANE, ANGLE = "shapes with a plane, %", "angle change, DFD's over the others'"
FLIPPED, OFF = "faces flipped by DFD, %", "handle off its target, % of the diagonal"

# What the paper says, what is measured, the rule, and its bound.
FIGURES: dict[str, Figure] = {
    "fig1": Figure("a plane of symmetry per shape", PLANE, column("plane %", preset=OURS), 100),
    "fig2": Figure("plausible, no number", FLIPPED, column("flipped %", preset=OURS), most=1),
    "fig3": Figure("targets reached", OFF, column("off %", preset=OURS), most=0.1),
    "fig4": Figure(
        "below 60 s (Lucy)", "seconds from render to weights", column("weights s", max, preset=OURS), most=60
    ),
    "fig5": Figure("score below 0.1", "score of the best plane", column("score", preset=OURS), most=0.1),
    "fig6": Figure("similar parts stay", "motion that is left", ratio("alike moves %", FIXED, FREE), most=0.5),
    "fig7": Figure("the horn alone", "area at λ = 32 over that at 0", ratio("follows %", FAR, WIDE), most=0.5),
    "fig8": Figure("targets without fixed points", OFF, column("handle off %", **DFD), most=0.1),
    "fig9": Figure("as smooth as biharmonic", ANGLE, ratio("angle °", DFD, COORDINATES), most=1),
    "fig10": Figure(
        "robust to size", "largest over smallest preprocessing", column("preprocess s", spread, method=OURS), most=3
    ),
    "fig11": Figure(
        "similar edits", "largest over smallest angle change", column("angle °", spread, preset=OURS), most=2
    ),
    "fig12": Figure(
        "similar weights", "correlation of the others with the first", column("correlation", preset=OURS), 0.7
    ),
    "fig13": Figure(
        "vertices give much worse weights",
        "distance from the fine copy's weights, vertices over pixels",
        ratio("off", VERTICES, PIXELS),
        1.5,
    ),
    "fig14": Figure("only related parts move", ANGLE, ratio("angle °", DFD, PEERS), most=1),
    "fig15": Figure("the others fail", "faces that the others fold, per shape", column("flipped faces", **FAILING), 1),
    "fig16": Figure("as smooth as biharmonic", ANGLE, ratio("angle °", DFD, COORDINATES), most=1),
    "fig17": Figure("no tears", "gap, % of the motion", column("gap %", preset=OURS), most=5),
    "fig18": Figure("constant training time T", "largest over smallest T", column("T s", spread, preset=OURS), most=2),
    "fig19": Figure("the same weights", "mean difference of weights", column("mean difference", preset=OURS), most=0.1),
    "fig20": Figure(
        "the same parts",
        "largest over smallest area of legs",
        column("follows %", spread, preset=OURS, variant="leg"),
        most=4,
    ),
    "fig21": Figure("reasonable shapes", "size of DFD's result over the shape's", column("size", **DFD), most=1.5),
    "fig22": Figure("DFD distorts more", "area change, DFD's over the others'", ratio("area %", DFD, PEERS), 1),
    "table1": Figure("every tick of Table 1", "ticks as in the paper, %", column("as in the paper, %"), 100),
    "table3": Figure("1,150 times (1 handle)", "OptCtrlPoints' seconds over DFD's", resolution.slower, 1000),
}
PAGES: dict[str, Callable[[Context], Page]] = {
    name: getattr(module, name)
    for name in FIGURES
    for module in (controls, features, comparisons, resolution)
    if hasattr(module, name)
}
SCREENS = "it shows screens of the paper's user study; fig14 draws such pictures"
CANNOT = {"fig23": SCREENS, "fig24": SCREENS, "table2": "the answers of the paper's user study are not available"}
