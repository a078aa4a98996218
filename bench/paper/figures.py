"""List the figures and tables of the paper: how each page is made, the paper's claims, and our bounds.

All bounds are our choice, except ε = 0.1 in Fig. 5. Each claim is judged for both presets. Where a page has marked
places, a claim holds only if these places follow as they should (`bench.paper.page.ALIKE`).
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np

from bench.paper import controls, features, resolution
from bench.paper.comparisons import COMPARED, FEW, JOBS, MANY, WITH_BALL, WITHOUT_BALL
from bench.paper.page import ALIKE, Claim, Figure, Page, Row, Rule
from bench.paper.resolution import COUNTS, FORWARD, LUCY, PHASES, of_count
from bench.paper.subjects import Context

METRICS = ("area %", "angle °", "edge %", "volume %")
SHAPES = 6  # smallest number of shapes for a claim of Fig. 22
BIHARMONIC_FAILS = 1e5  # number of faces above which the paper's biharmonic coordinates fail
GROWS_LESS = 0.1  # a power of growth is lower than another if it is at least this much lower
ORDERS = 100  # the paper says that DFD binds new handles several orders of magnitude faster


def values(rows: Sequence[Row], name: str, noted: bool = False, **where: Any) -> list[float]:
    """Return the values of column `name` in the rows whose other columns have the values `where`.

    If `noted`, also of results that are too large to be drawn.
    """
    fitting = (row for row in rows if all(row.get(key) == each for key, each in where.items()))
    return [row[name] for row in fitting if row.get(name) is not None and (noted or not row.get("note"))]


def over(dividend: float, divisor: float) -> float:
    """Return the quotient of two numbers, of which the divisor may be 0."""
    return dividend / max(divisor, 1e-9)


def column(name: str, reduce: Callable[[Any], Any] = np.mean, **where: Any) -> Rule:
    """Return a rule that applies `reduce` to the values of our method in column `name`."""

    def number(rows: Sequence[Row], own: str) -> float:
        found = values(rows, name, method=own, **where)
        return float(reduce(found)) if found else np.nan

    return number


def ratio(first: Rule, second: Rule, least: float = 0.0) -> Rule:
    """Return a rule: the quotient of two rules; NaN if the second number is below `least`."""

    def number(rows: Sequence[Row], own: str) -> float:
        divisor = second(rows, own)
        return over(first(rows, own), divisor) if divisor >= least else np.nan

    return number


def spread(found: Any) -> float:
    """Return the largest of the values `found`, divided by the smallest; NaN for a single value."""
    return float(over(max(found), min(found))) if len(found) > 1 else np.nan


def magnitude(found: Any) -> float:
    """Return the median magnitude of the values `found`."""
    return float(np.median(np.abs(found)))


def against(name: str, *peers: str, reduce: Callable[[Any], Any] = max, shapes: int = 1, **where: Any) -> Rule:
    """Return a rule: the median magnitude of column `name` by our method, divided by that of each of `peers`.

    Each peer is compared on the shapes on which it gives a result. `reduce` gives one number for all peers. The number
    is NaN with fewer than `shapes` shapes.
    """

    def number(rows: Sequence[Row], own: str) -> float:
        found, some = [], [row for row in rows if all(row.get(key) == each for key, each in where.items())]
        for peer in peers:
            common = {row["shape"] for row in some if values([row], name, method=peer)}
            both = [values([row for row in some if row["shape"] in common], name, method=each) for each in (own, peer)]
            if all(both) and len(common) >= shapes:
                found.append(over(*map(magnitude, both)))
        return float(reduce(found)) if len(found) == len(peers) else np.nan

    return number


def distorts_more(variant: str) -> Rule:
    """Return a rule: the least quotient of a measure of distortion by our method and another, over all of both."""

    def number(rows: Sequence[Row], own: str) -> float:
        found = (against(each, *COMPARED, reduce=min, shapes=SHAPES, variant=variant) for each in METRICS)
        return float(np.min([each(rows, own) for each in found]))

    return number


def growth(rows: Sequence[Row], method: str, phase: str, sizes: Sequence[int]) -> float:
    """Return the power of the number of faces with which the seconds of `phase` grow: a line fitted to logarithms."""
    found = [(n, t) for n in sizes for t in values(rows, phase, method=method, faces=n)]
    return float(np.polyfit(*np.log(found).T, 1)[0]) if len({n for n, _ in found}) > 1 else np.nan


def sizes_of(rows: Sequence[Row], method: str, phase: str) -> list[int]:
    """Return the numbers of faces at which `method` has seconds of `phase`."""
    return sorted({row["faces"] for row in rows if row["method"] == method and row.get(phase)})


def power(rows: Sequence[Row], own: str) -> float:
    """Return the larger power of growth of our seconds to bind and to pose; below 1, the time is sublinear."""
    return float(np.max([growth(rows, own, phase, sizes_of(rows, own, phase)) for phase in PHASES[1:]]))


def steeper(rows: Sequence[Row], own: str) -> float:
    """Return the largest lead of our power of growth over another method's, on the sizes that this method reaches."""
    found = []
    for phase, peer in product(PHASES, COMPARED):
        sizes = sizes_of(rows, peer, phase)
        found.append(growth(rows, own, phase, sizes) - growth(rows, peer, phase, sizes))
    return max((each for each in found if np.isfinite(each)), default=np.nan)


def at_fewest_faces(rows: Sequence[Row], own: str) -> float:
    """Return our seconds of all phases divided by those of biharmonic coordinates, on the smallest meshes."""
    few = min((row["faces"] for row in rows), default=0)
    ours, others = (
        sum(np.mean(values(rows, phase, method=method, faces=few) or [np.nan]) for phase in PHASES)
        for method in (own, "biharmonic")
    )
    return over(ours, others)


def most_faces(rows: Sequence[Row], own: str) -> float:
    """Return the largest number of faces at which biharmonic coordinates gave a result; NaN if no mesh has > 10⁵."""
    tried = max((row["faces"] for row in rows if row["method"] == own), default=0)
    return float(max(sizes_of(rows, "biharmonic", "bind s"), default=0)) if tried > 1.5 * BIHARMONIC_FAILS else np.nan


def at_lucy(rows: Sequence[Row], own: str) -> float:
    """Return the largest "R + T s" on meshes of the size of the scan Lucy; NaN without such a mesh."""
    found = [s for r in rows for s in values([r], "R + T s", method=own) if r["faces"] > 0.9 * LUCY]
    return max(found, default=np.nan)


def of_encoders(rule: Rule) -> Rule:
    """Return `rule`, or NaN if all features come from blocks of one encoder."""
    return lambda rows, own: rule(rows, own) if len({row.get("encoder") for row in rows}) > 1 else np.nan


def speedup(rows: Sequence[Row], own: str) -> float:
    """Return the least quotient of the seconds of OptCtrlPoints and ours, over `COUNTS`, on the most nodes."""
    most, found = max((row["nodes"] for row in rows if row.get("nodes")), default=0), []
    for name in map(of_count, COUNTS):
        both = ("OptCtrlPoints", {}), (own, {"variant": FORWARD})
        theirs, ours = (np.median(values(rows, name, method=m, nodes=most, **w) or [np.nan]) for m, w in both)
        found.append(theirs / ours)
    return float(np.min(found))


def least_ticks(rows: Sequence[Row], own: str) -> float:
    """Return the least share of ticks as in the paper, over our method and the others; NaN if one has no result."""
    found = [values(rows, "as in the paper, %", method=method) for method in (own, *COMPARED)]
    return min(map(min, found)) if all(found) else np.nan


ENCODER = "at the same place of a picture, our encoder gives different features to left and right"
HARDWARE = "two cores instead of an NVIDIA A40"
STRETCHES = "DFD stretches whole parts, and the other methods spread the stretch over the shape"
RIGHT_PAIRS = "pairs of marked places in the right order, %"


def high(paper: str, measured: str, number: Rule, least: float, marked: bool = True) -> Claim:
    """Return a claim that holds for numbers of at least `least`."""
    return Claim(paper, measured, number, least=least, marked=marked)


def low(paper: str, measured: str, number: Rule, most: float, marked: bool = True) -> Claim:
    """Return a claim that holds for numbers of at most `most`."""
    return Claim(paper, measured, number, most=most, marked=marked)


def figure(make: Callable[[Context], Page], *claims: Claim, cause: str = "") -> Figure:
    """Return a figure with `claims`."""
    return Figure(make, claims, cause)


def of_variants(name: str, first: str, second: str, least: float = 0.0) -> Rule:
    """Return a rule: the mean of column `name` in rows with the variant `first`, divided by that with `second`."""
    return ratio(column(name, variant=first), column(name, variant=second), least)


def degenerates(peer: str) -> Claim:
    """Return the claim of Fig. 15 that `peer` fails if it constrains only points."""
    both = (column("edge %", magnitude, noted=True, variant=each) for each in (WITHOUT_BALL, WITH_BALL))
    rule = ratio(*both)
    said = f"change of edges by {peer}, points only / with a ball"
    return high(f"{peer} degenerates without a ball", said, lambda rows, _: rule(rows, peer), 2)


SMOOTH = [
    low("as smooth as biharmonic", "angle change, DFD / biharmonic", against("angle °", "biharmonic"), 1),
    low("more structure-aware", "asymmetry, DFD / biharmonic", against("asymmetry %", "biharmonic"), 1),
]
FIGURES: dict[str, Figure] = {
    "fig1": figure(
        controls.fig1,
        high("a plane for every shape", "shapes with a plane, %", column("plane found %"), 100, marked=False),
        cause=ENCODER,
    ),
    "fig2": figure(controls.fig2, low("plausible pictures", "flipped faces, %", column("flipped %"), 1)),
    "fig3": figure(controls.fig3, high("edits propagate to related parts", RIGHT_PAIRS, column("agreement %"), ALIKE)),
    "fig4": figure(
        features.fig4,
        low("virtually identical fields", "difference / spread", ratio(column("mean distance"), column("spread")), 0.5),
    ),
    "fig5": figure(
        controls.fig5, low("score below 0.1", "largest score", column("score", max), 0.1, marked=False), cause=ENCODER
    ),
    "fig6": figure(
        controls.fig6,
        low(
            "what looks like the fixed point stays",
            "motion of similar places, fixed / free",
            of_variants("similar places move %", controls.FIXED, controls.FREE, 0.5),
            0.2,
        ),
    ),
    "fig7": figure(
        controls.fig7,
        low(
            "the head turns without locality, only the horn with it",
            "weight at related places, λ = 32 / λ = 0",
            of_variants("related places follow %", "λ = 32", "λ = 0"),
            0.2,
        ),
    ),
    "fig8": figure(
        JOBS["fig8"], low("unrelated parts stay", "motion of fixed points, %", column("fixed points move %"), 25)
    ),
    "fig9": figure(JOBS["fig9"], *SMOOTH, cause=STRETCHES),
    "fig10": figure(
        resolution.fig10,
        low("robust to size", "longest / shortest preprocessing", column("preprocess s", spread), 3),
        low("as fast as biharmonic at 10³ faces", "seconds of all phases, DFD / biharmonic", at_fewest_faces, 1),
        low("biharmonic fails past 10⁵ faces", "most faces with biharmonic", most_faces, BIHARMONIC_FAILS),
        low("scales best in every phase", "power of growth, DFD − least, worst phase", steeper, -GROWS_LESS),
        low("sublinear in bind and pose", "larger power of growth", power, 1 - GROWS_LESS),
        cause=f"distillation takes a fixed time, and binding includes the forward pass at every vertex; {HARDWARE}",
    ),
    "fig11": figure(
        features.fig11, low("similar edits", "largest / least angle", of_encoders(column("angle °", spread)), 2)
    ),
    "fig12": figure(
        features.fig12,
        high("similar weights", "correlation with the first encoder's", of_encoders(column("correlation")), 0.7),
    ),
    "fig13": figure(
        features.fig13,
        high(
            "training on vertices gives much worse weights",
            "difference from the fine mesh's weights, vertices / all pixels",
            of_variants("mean difference", features.VERTICES_ALONE, features.ALL_PIXELS),
            1.5,
        ),
    ),
    "fig14": figure(
        JOBS["fig14"],
        low("symmetry-aware; others are not", "asymmetry, DFD / least", against("asymmetry %", *COMPARED), 1),
        low(
            "others move the shape as a whole",
            "motion elsewhere, DFD / least",
            against("unrelated places move %", *COMPARED),
            1,
        ),
    ),
    "fig15": figure(
        JOBS["fig15"],
        degenerates("biharmonic"),
        degenerates("NeuralMLS"),
        cause="not shown: our implementations have unique weights also with few handles, and reach their targets",
    ),
    "fig16": figure(JOBS["fig16"], *SMOOTH, cause=STRETCHES),
    "fig17": figure(resolution.fig17, low("no tears", "largest gap, % of the motion", column("gap %", max), 5)),
    "fig18": figure(
        resolution.fig18,
        low("constant training time T", "longest / shortest T", column("T s", spread), 2),
        low("28 million faces in a minute", "s to distill", at_lucy, 60),
        cause=HARDWARE,
    ),
    "fig19": figure(
        features.fig19,
        low("same weights on remeshings", "largest ratio of areas", column("area, larger / smaller", max), 1.5),
        high("remeshings follow alike", "least agreement, %", column("agreement of copies %", min), ALIKE),
        high("other shapes follow alike", "lowest agreement, %", column("agreement of other shapes %", min), ALIKE),
    ),
    "fig20": figure(features.fig20, high("handles select the same parts", RIGHT_PAIRS, column("agreement %"), ALIKE)),
    "fig21": figure(
        JOBS["fig21"],
        low("reasonable shapes", "diagonal of the result / of the shape", column("size", max, noted=True), 1.5),
        cause="where weights sum to more than 1, Eq. 1 multiplies positions by the sum",
    ),
    "fig22": figure(
        JOBS["fig22"],
        *(
            high("more distortion than all others", f"least of 12 quotients, {each}", distorts_more(each), 1)
            for each in (FEW, MANY)
        ),
        cause="few fixed points hold the shape loosely, so the other method shears it as a whole",
    ),
    "table1": figure(resolution.table1, high("every tick of Table 1", "least share of ticks, %", least_ticks, 100)),
    "table3": figure(
        resolution.table3,
        high("641 to 1,150 times as fast", "least of 3 quotients of seconds, OptCtrlPoints / DFD", speedup, ORDERS),
        cause="all but K + 4 equations of our system are factored before, and the paper does not state its nodes; "
        + HARDWARE,
    ),
}
SCREENS = "it shows screenshots of the paper's user study; fig14 draws such pictures"
STUDY = "the answers of the paper's user studies are not available"
CANNOT = {"fig23": SCREENS, "fig24": SCREENS, "table2": STUDY}
