"""List what each figure and table of the paper claims, and the number that decides whether our result agrees.

If the paper gives no number, the bound is our choice.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bench.paper import comparisons, controls, features, resolution
from bench.paper.page import Figure, Page, Row, Rule
from bench.paper.subjects import NAMES, Context

OURS = NAMES["paper"]


def column(name: str, reduce: Callable[[Any], Any] = np.mean, **where: Any) -> Rule:
    """Return a rule that applies `reduce` to column `name` of the rows whose other columns have the values `where`."""

    def number(rows: Sequence[Row]) -> float:
        fitting = [row for row in rows if all(row.get(key) in np.atleast_1d(each) for key, each in where.items())]
        found = [row[name] for row in fitting if row.get(name) is not None]
        return float(reduce(found)) if found else float("nan")

    return number


def ratio(name: str, dividend: dict[str, Any], divisor: dict[str, Any]) -> Rule:
    """Return a rule: mean of column `name` over rows with `dividend`, divided by its mean over rows with `divisor`."""
    return lambda rows: column(name, **dividend)(rows) / max(column(name, **divisor)(rows), 1e-9)


def spread(found: Any) -> float:
    """Return the largest of the values `found` divided by the smallest."""
    return float(max(found) / max(min(found), 1e-9))


# Conditions that select rows. PEERS and COORDINATES skip rows with a note: a method failed, or its result is too large.
DFD = {"method": OURS}
PEERS, COORDINATES = ({"method": each, "note": ""} for each in (comparisons.COMPARED, "biharmonic"))
FAILING = {"method": comparisons.COMPARED}
FREE, FIXED, FAR, WIDE = ({"preset": OURS, "variant": each} for each in ("free", "fixed", "λ = 32", "λ = 0"))
PIXELS, VERTICES = ({"variant": name} for name in ("paper preset, coarse copy, all pixels", features.VERTICES_ALONE))
PLANE, ANGLE, SIMILAR = "shapes with a plane, %", "angle change, DFD /", "similar vertices"
FLIPPED, ERROR = "faces flipped by DFD, %", "distance of the handle from its target, % of the diagonal"

# For each page: the claim of the paper, what our number measures, the rule that computes it, and its bound.
FIGURES: dict[str, Figure] = {
    "fig1": Figure("a plane of symmetry for every shape", PLANE, column("plane found %", preset=OURS), 100),
    "fig2": Figure("plausible pictures", FLIPPED, column("flipped %", preset=OURS), most=1),
    "fig3": Figure("handles reach their targets", ERROR, column("handle error %", preset=OURS), most=0.1),
    "fig4": Figure("at most 60 s for Lucy", "s to distill and bind", column("weights s", max, preset=OURS), most=60),
    "fig5": Figure("score below 0.1", "score of the best plane", column("score", preset=OURS), most=0.1),
    "fig6": Figure(
        "similar parts stay", "motion of similar parts, fixed / free", ratio(f"{SIMILAR} move %", FIXED, FREE), most=0.5
    ),
    "fig7": Figure("only the horn moves", "area at λ = 32 / at λ = 0", ratio("follows %", FAR, WIDE), most=0.5),
    "fig8": Figure("targets reached without fixed points", ERROR, column("handle error %", **DFD), most=0.1),
    "fig9": Figure("as smooth as biharmonic", f"{ANGLE} biharmonic", ratio("angle °", DFD, COORDINATES), most=1),
    "fig10": Figure(
        "robust to size", "longest / shortest preprocessing", column("preprocess s", spread, **DFD), most=3
    ),
    "fig11": Figure("similar edits", "largest / smallest angle change", column("angle °", spread, preset=OURS), most=2),
    "fig12": Figure(
        "similar weights", "correlation with the first encoder's weights", column("correlation", preset=OURS), 0.7
    ),
    "fig13": Figure(
        "training on vertices gives much worse weights",
        "difference from weights of the fine mesh's field, trained on vertices / on all pixels",
        ratio("mean difference", VERTICES, PIXELS),
        1.5,
    ),
    "fig14": Figure("only related parts move", f"{ANGLE} other methods", ratio("angle °", DFD, PEERS), most=1),
    "fig15": Figure("the other methods fail", "flipped faces per shape", column("flipped faces", **FAILING), 1),
    "fig16": Figure("as smooth as biharmonic", f"{ANGLE} biharmonic", ratio("angle °", DFD, COORDINATES), most=1),
    "fig17": Figure("no tears", "mean gap, % of the largest motion", column("gap %", preset=OURS), most=5),
    "fig18": Figure("constant training time T", "longest / shortest T", column("T s", spread, preset=OURS), most=2),
    "fig19": Figure("the same weights", "mean difference of weights", column("mean difference", preset=OURS), most=0.1),
    "fig20": Figure(
        "handles select the same parts",
        "largest / smallest area of legs",
        column("follows %", spread, preset=OURS, variant="leg"),
        most=4,
    ),
    "fig21": Figure("reasonable shapes", "diagonal of the result / of the shape", column("size", **DFD), most=1.5),
    "fig22": Figure("DFD distorts more", "area change, DFD / other methods", ratio("area %", DFD, PEERS), 1),
    "table1": Figure("every tick of Table 1", "ticks as in the paper, %", column("as in the paper, %"), 100),
    "table3": Figure("1,150 times as fast for 1 handle", "seconds, OptCtrlPoints / DFD", resolution.speedup, 1000),
}
PAGES: dict[str, Callable[[Context], Page]] = {
    name: getattr(module, name)
    for name in FIGURES
    for module in (controls, features, comparisons, resolution)
    if hasattr(module, name)
}
SCREENS = "it shows screenshots of the paper's user study; fig14 draws such pictures"
CANNOT = {"fig23": SCREENS, "fig24": SCREENS, "table2": "the answers of the paper's user study are not available"}
