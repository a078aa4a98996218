"""List the figures and tables of the paper: how each page is made, the paper's claims, and our bounds.

All bounds are our choice, except ε = 0.1 in Fig. 5. Each claim is judged for both presets. Where a page has marked
places, a claim holds only if these places follow as they should (`bench.paper.page.ALIKE`).
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bench.paper import controls, features, resolution
from bench.paper.comparisons import FEW, JOBS, MANY, WITH_BALL, WITHOUT_BALL
from bench.paper.page import ALIKE, Claim, Figure, Row, Rule
from bench.paper.resolution import FORWARD, KEPT, LUCY, PHASES, TIMED_PEERS, of_count

METRICS = ("area %", "angle °", "edge %", "volume %")
SHAPES = 6  # smallest number of shapes for a claim of Fig. 22
BIHARMONIC_FAILS = 1e5  # number of faces above which the paper's biharmonic coordinates fail
GROWS_LESS = 0.1  # a power of growth is lower than another if it is at least this much lower
ORDERS = 100  # the paper says that DFD binds new handles several orders of magnitude faster
NAN = float("nan")


def values(rows: Sequence[Row], name: str, **where: Any) -> list[float]:
    """Return the values of column `name` in the rows whose other columns have the values `where`."""
    fitting = (row for row in rows if all(row.get(key) == each for key, each in where.items()))
    return [row[name] for row in fitting if row.get(name) is not None and not row.get("note")]


def over(dividend: float, divisor: float) -> float:
    """Return the quotient of two numbers, of which the divisor may be 0."""
    return dividend / max(divisor, 1e-9)


def column(name: str, reduce: Callable[[Any], Any] = np.mean, **where: Any) -> Rule:
    """Return a rule that applies `reduce` to the values of our method in column `name`."""

    def number(rows: Sequence[Row], own: str) -> float:
        found = values(rows, name, method=own, **where)
        return float(reduce(found)) if found else NAN

    return number


def ratio(first: Rule, second: Rule, least: float = 0.0) -> Rule:
    """Return a rule: the quotient of two rules; NaN if the second number is below `least`."""

    def number(rows: Sequence[Row], own: str) -> float:
        divisor = second(rows, own)
        return over(first(rows, own), divisor) if divisor >= least else NAN

    return number


def spread(found: Any) -> float:
    """Return the largest of the values `found`, divided by the smallest; NaN for a single value."""
    return float(over(max(found), min(found))) if len(found) > 1 else NAN


def magnitude(found: Any) -> float:
    """Return the median magnitude of the values `found`."""
    return float(np.median(np.abs(found)))


def against(name: str, *peers: str, reduce: Callable[[Any], Any] = max, shapes: int = 1, **where: Any) -> Rule:
    """Return a rule: the median magnitude of column `name` by our method, divided by that of each of `peers`.

    Each peer is compared on the shapes on which it gives a result. `reduce` gives one number for all peers. The number
    is NaN with fewer than `shapes` shapes.
    """

    def number(rows: Sequence[Row], own: str) -> float:
        found = []
        for peer in peers:
            common = [r["shape"] for r in rows if r["method"] == peer and r.get(name) is not None and not r.get("note")]
            some = [row for row in rows if row["shape"] in common]
            both = [values(some, name, method=each, **where) for each in (own, peer)]
            if all(both) and len(set(common)) >= shapes:
                found.append(over(*map(magnitude, both)))
        return float(reduce(found)) if len(found) == len(peers) else NAN

    return number


def distorts_more(peer: str, variant: str) -> Rule:
    """Return a rule: the least quotient of a measure of distortion by our method and by `peer`, over `METRICS`."""

    def number(rows: Sequence[Row], own: str) -> float:
        return float(np.min([against(each, peer, shapes=SHAPES, variant=variant)(rows, own) for each in METRICS]))

    return number


def growth(rows: Sequence[Row], method: str, phase: str, sizes: Sequence[int]) -> float:
    """Return the power of the number of faces with which the seconds of `phase` grow: a line fitted to logarithms."""
    found = [(n, t) for n in sizes for t in values(rows, phase, method=method, faces=n)]
    return float(np.polyfit(*np.log(found).T, 1)[0]) if len({n for n, _ in found}) > 1 else NAN


def sizes_of(rows: Sequence[Row], method: str, phase: str) -> list[int]:
    """Return the numbers of faces at which `method` has seconds of `phase`."""
    return sorted({row["faces"] for row in rows if row["method"] == method and row.get(phase)})


def power(phase: str) -> Rule:
    """Return a rule: the power of growth of our seconds; below 1, the time is sublinear."""
    return lambda rows, own: growth(rows, own, phase, sizes_of(rows, own, phase))


def steeper(phase: str) -> Rule:
    """Return a rule: our power of growth less that of the method that grows least, on the sizes that it reaches."""

    def number(rows: Sequence[Row], own: str) -> float:
        found = []
        for peer in TIMED_PEERS:
            sizes = sizes_of(rows, peer, phase)
            found.append(growth(rows, own, phase, sizes) - growth(rows, peer, phase, sizes))
        return max((each for each in found if np.isfinite(each)), default=NAN)

    return number


def at_fewest_faces(rows: Sequence[Row], own: str) -> float:
    """Return our seconds of all phases divided by those of biharmonic coordinates, on the smallest meshes."""
    few = min((row["faces"] for row in rows), default=0)
    ours, others = (
        sum(np.mean(values(rows, phase, method=method, faces=few) or [NAN]) for phase in PHASES)
        for method in (own, "biharmonic")
    )
    return over(ours, others)


def most_faces(rows: Sequence[Row], own: str) -> float:
    """Return the largest number of faces at which biharmonic coordinates gave a result; NaN if no mesh has > 10⁵."""
    tried = max((row["faces"] for row in rows if row["method"] == own), default=0)
    return float(max(sizes_of(rows, "biharmonic", "bind s"), default=0)) if tried > 1.5 * BIHARMONIC_FAILS else NAN


def at_lucy(rows: Sequence[Row], own: str) -> float:
    """Return the largest "R + T s" on meshes of the size of the scan Lucy; NaN without such a mesh."""
    found = [s for r in rows for s in values([r], "R + T s", method=own) if r["faces"] > 0.9 * LUCY]
    return max(found, default=NAN)


def of_encoders(rule: Rule) -> Rule:
    """Return `rule`, or NaN if all features come from blocks of one encoder."""
    return lambda rows, own: rule(rows, own) if len({row.get("encoder") for row in rows}) > 1 else NAN


def speedup(count: int, how: str) -> Rule:
    """Return a rule: the seconds of OptCtrlPoints divided by ours, for `count` handles on the most nodes."""

    def number(rows: Sequence[Row], own: str) -> float:
        name, most = of_count(count), max((row["nodes"] for row in rows if row.get("nodes")), default=0)
        both = (
            values(rows, name, method=m, nodes=most, **w) for m, w in (("OptCtrlPoints", {}), (own, {"variant": how}))
        )
        theirs, ours = (float(np.median(each or [NAN])) for each in both)
        return theirs / ours

    return number


ENCODER = "at the same place of a picture, our encoder gives different features to left and right"
HARDWARE = "two cores instead of an NVIDIA A40"
STRETCHES = "DFD stretches whole parts, and the other methods spread the stretch over the shape"
DEGENERATE = "not shown: our implementations have unique weights also with few handles, and reach their targets"
NODES = (
    "our system for OptCtrlPoints takes 0.03 s on a few thousand nodes, because all but K + 4 equations are factored "
    "before; it grows faster than the number of nodes, which the paper does not state. " + HARDWARE
)
ONE = "all features are from blocks of one encoder"


def agrees(paper: str, **where: Any) -> Claim:
    """Return the claim that marked places follow as they should."""
    measured = "pairs of marked places in the right order, %"
    return Claim(
        paper,
        measured,
        column("agreement %", **where),
        ALIKE,
        cause="features of our small encoder differ less between parts",
    )


def smooth() -> tuple[Claim, ...]:
    """Return the claims of Fig. 9 and 16."""
    more = "as smooth as biharmonic", "more structure-aware than biharmonic"
    return (
        Claim(more[0], "angle change, DFD / biharmonic", against("angle °", "biharmonic"), most=1, cause=STRETCHES),
        Claim(more[1], "asymmetry, DFD / biharmonic", against("asymmetry %", "biharmonic"), most=1),
    )


FIGURES: dict[str, Figure] = {
    "fig1": Figure(
        controls.fig1,
        [
            Claim(
                "a plane of symmetry for every shape",
                "shapes with a plane, %",
                column("plane found %"),
                100,
                cause=ENCODER,
                marked=False,
            )
        ],
    ),
    "fig2": Figure(controls.fig2, [Claim("plausible pictures", "flipped faces, %", column("flipped %"), most=1)]),
    "fig3": Figure(controls.fig3, [agrees("edits propagate to related parts")]),
    "fig4": Figure(
        features.fig4,
        [
            Claim(
                "virtually identical fields",
                "distance of both fields / spread of the features",
                ratio(column("mean distance"), column("spread")),
                most=0.5,
            )
        ],
    ),
    "fig5": Figure(
        controls.fig5,
        [Claim("score below 0.1", "largest score", column("score", max), most=0.1, cause=ENCODER, marked=False)],
    ),
    "fig6": Figure(
        controls.fig6,
        [
            Claim(
                "what looks like the fixed point stays",
                "motion of similar vertices, fixed / free",
                ratio(
                    column("similar vertices move %", variant=controls.FIXED),
                    column("similar vertices move %", variant=controls.FREE),
                    least=0.5,
                ),
                most=0.2,
            )
        ],
    ),
    "fig7": Figure(
        controls.fig7,
        [
            Claim(
                "the head turns without locality, only the horn with it",
                "weight at related places, λ = 32 / λ = 0",
                ratio(
                    column("related places follow %", variant="λ = 32"),
                    column("related places follow %", variant="λ = 0"),
                ),
                most=0.2,
                cause="by default, distances start at the mirror image of the handle, too",
            )
        ],
    ),
    "fig8": Figure(
        JOBS["fig8"],
        [
            Claim(
                "unrelated parts stay without fixed points",
                "motion of others' fixed points, % of the handle's",
                column("fixed points move %"),
                most=25,
            )
        ],
    ),
    "fig9": Figure(JOBS["fig9"], smooth()),
    "fig10": Figure(
        resolution.fig10,
        [
            Claim("robust to size", "longest / shortest preprocessing", column("preprocess s", spread), most=3),
            Claim(
                "as fast as biharmonic at the lowest resolution",
                "seconds at 10³ faces, DFD / biharmonic",
                at_fewest_faces,
                most=1,
                cause=f"distillation takes a fixed time, and tetrahedra of a small mesh take a second; {HARDWARE}",
            ),
            Claim("biharmonic fails past 10⁵ faces", "most faces with biharmonic", most_faces, most=BIHARMONIC_FAILS),
            *(
                Claim(
                    f"scales better than all methods in {phase.removesuffix(' s')}",
                    f"power of growth in {phase.removesuffix(' s')}, DFD − least of others",
                    steeper(phase),
                    most=-GROWS_LESS,
                )
                for phase in PHASES
            ),
            *(
                Claim(f"sublinear in {each}", f"power of growth in {each}", power(f"{each} s"), most=1 - GROWS_LESS)
                for each in ("bind", "pose")
            ),
        ],
    ),
    "fig11": Figure(
        features.fig11,
        [
            Claim(
                "similar edits by all encoders",
                "largest / smallest angle change",
                of_encoders(column("angle °", spread)),
                most=2,
                cause=ONE,
            )
        ],
    ),
    "fig12": Figure(
        features.fig12,
        [
            Claim(
                "similar weights by all encoders",
                "correlation with the first encoder's weights",
                of_encoders(column("correlation")),
                0.7,
                cause=ONE,
            )
        ],
    ),
    "fig13": Figure(
        features.fig13,
        [
            Claim(
                "training on vertices gives much worse weights",
                "difference from the fine mesh's weights, vertices / all pixels",
                ratio(
                    column("mean difference", variant=features.VERTICES_ALONE),
                    column("mean difference", variant=features.ALL_PIXELS),
                ),
                1.5,
            )
        ],
    ),
    "fig14": Figure(
        JOBS["fig14"],
        [
            Claim(
                "symmetry-aware; others are asymmetric",
                "asymmetry, DFD / least of others",
                against("asymmetry %", *TIMED_PEERS),
                most=1,
            ),
            Claim(
                "others move the shape as a whole",
                "motion of unrelated places, DFD / least of others",
                against("unrelated places move %", *TIMED_PEERS),
                most=1,
            ),
        ],
    ),
    "fig15": Figure(
        JOBS["fig15"],
        [
            Claim(
                f"{method} degenerates without a ball",
                f"change of edges by {method}, points only / with a ball",
                lambda rows, _, method=method: ratio(
                    column("edge %", magnitude, variant=WITHOUT_BALL), column("edge %", magnitude, variant=WITH_BALL)
                )(rows, method),
                2,
                cause=DEGENERATE,
            )
            for method in ("biharmonic", "NeuralMLS")
        ],
    ),
    "fig16": Figure(JOBS["fig16"], smooth()),
    "fig17": Figure(
        resolution.fig17, [Claim("no tears", "largest gap, % of the largest motion", column("gap %", max), most=5)]
    ),
    "fig18": Figure(
        resolution.fig18,
        [
            Claim("constant training time T", "longest / shortest T", column("T s", spread), most=2),
            Claim("28 million faces in a minute", "s to distill", at_lucy, most=60, cause=HARDWARE),
        ],
    ),
    "fig19": Figure(
        features.fig19,
        [
            Claim(
                "the same weights on remeshings",
                "largest ratio of the area that follows",
                column("area, larger / smaller", max),
                most=1.5,
                cause="on few faces, parts merge",
            ),
            Claim(
                "remeshings: what follows is alike",
                "least agreement of a remeshing, %",
                column("agreement of copies %", min),
                ALIKE,
            ),
            Claim(
                "other shapes of the class: legs follow together",
                "least agreement of a shape, %",
                column("agreement of other shapes %", min),
                ALIKE,
                cause="hind legs lie elsewhere in the field's space",
            ),
        ],
    ),
    "fig20": Figure(features.fig20, [agrees("handles select the same parts")]),
    "fig21": Figure(
        JOBS["fig21"],
        [
            Claim(
                "reasonable shapes",
                "diagonal of the result / of the shape",
                lambda rows, own: float(
                    np.mean([r["size"] for r in rows if r["method"] == own and r.get("size")] or [NAN])
                ),
                most=1.5,
                cause="where weights sum to more than 1, Eq. 1 multiplies positions by the sum",
            )
        ],
    ),
    "fig22": Figure(
        JOBS["fig22"],
        [
            Claim(
                f"DFD distorts more than {method}",
                f"least of four measures, DFD / {method}, {variant}",
                distorts_more(method, variant),
                1,
                cause="few fixed points hold the shape loosely, so the other method shears it as a whole",
            )
            for variant in (FEW, MANY)
            for method in TIMED_PEERS
        ],
    ),
    "table1": Figure(
        resolution.table1,
        [
            Claim(
                "every tick of Table 1",
                "least share of ticks as in the paper, %",
                lambda rows, own: min(
                    (
                        each
                        for method in (own, *TIMED_PEERS)
                        for each in values(rows, "as in the paper, %", method=method)
                    ),
                    default=NAN,
                ),
                100,
            )
        ],
    ),
    "table3": Figure(
        resolution.table3,
        [
            Claim(paper, f"{of_count(count)}, OptCtrlPoints / DFD ({how})", speedup(count, how), ORDERS, cause=NODES)
            for count, how, paper in (
                (1, FORWARD, "1,150 times as fast for 1 handle"),
                (10, FORWARD, "946 times as fast for 10"),
                (100, FORWARD, "641 times as fast for 100"),
                (1, KEPT, "not measured"),
                (100, KEPT, "not measured"),
            )
        ],
    ),
}
SCREENS = "it shows screenshots of the paper's user study; fig14 draws such pictures"
STUDY = "the answers of the paper's user studies are not available"
CANNOT = {"fig23": SCREENS, "fig24": SCREENS, "table2": STUDY}
