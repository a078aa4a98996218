"""List the claims of each figure and table of the paper, and the numbers that show whether our results are alike.

All bounds are our choice, except ε = 0.1 in Fig. 5.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bench.paper import comparisons, controls, features, resolution
from bench.paper.page import Claim, Page, Row, Rule
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


def relative(name: str, divisor: str, **where: Any) -> Rule:
    """Return a rule: mean of column `name` divided by the mean of column `divisor`, over rows with `where`."""
    return lambda rows: column(name, **where)(rows) / max(column(divisor, **where)(rows), 1e-9)


def held(rows: Sequence[Row]) -> float:
    """Return the motion of similar parts in `fig6`, fixed / free; NaN if they hardly move when they are free."""
    free = column(MOTION, **FREE)(rows)
    return ratio(MOTION, FIXED, FREE)(rows) if free >= LEAST_MOTION else float("nan")


def growth(phase: str) -> Rule:
    """Return a rule: the power of the number of faces with which the seconds of `phase` grow, for the paper's preset.

    The power is that between the smallest and the largest meshes; below 1, the time is sublinear.
    """

    def power(rows: Sequence[Row]) -> float:
        faces = [row["faces"] for row in rows if row.get("method") == OURS and row.get(phase)]
        if not faces or max(faces) == min(faces):
            return float("nan")
        ends = [column(phase, method=OURS, faces=[each])(rows) for each in (min(faces), max(faces))]
        return float(np.log(ends[1] / ends[0]) / np.log(max(faces) / min(faces)))

    return power


def slowest_phase(rows: Sequence[Row]) -> float:
    """Return the largest quotient of the seconds of DFD and of a method in `fig10`, over phases, methods and sizes."""
    found = []
    for row in rows:
        if row.get("method") in resolution.TIMED_PEERS:
            own = {"shape": row["shape"], "faces": [row["faces"]], "method": OURS}
            found += [column(phase, **own)(rows) / row[phase] for phase in resolution.PHASES if row.get(phase)]
    return max(found, default=float("nan"))


def at_fewest_faces(rows: Sequence[Row]) -> float:
    """Return the seconds of all phases by DFD divided by those by biharmonic coordinates, on the smallest meshes."""
    few = min((row["faces"] for row in rows), default=0)
    own, other = (
        [column(phase, method=method, faces=[few])(rows) for phase in resolution.PHASES]
        for method in (OURS, "biharmonic")
    )
    return sum(own) / sum(other)


def most_faces(method: str) -> Rule:
    """Return a rule: the largest number of faces at which `method` gave a result; NaN if no mesh has more than 10⁵."""

    def number(rows: Sequence[Row]) -> float:
        done = [row["faces"] for row in rows if row.get("method") == method and row.get("bind s") is not None]
        tried = max((row["faces"] for row in rows), default=0)
        return float(max(done, default=0)) if tried > FAILING else float("nan")

    return number


# Conditions that select rows. Rows with a note are skipped: a method failed, or its result is too large.
DFD = {"method": OURS}
FREE, FIXED, FAR, WIDE = ({"preset": OURS, "variant": each} for each in ("free", "fixed", "λ = 32", "λ = 0"))
PIXELS, VERTICES = ({"variant": name} for name in ("paper preset, coarse copy, all pixels", features.VERTICES_ALONE))
PLANE, FLIPPED = "shapes with a plane, %", "faces flipped by DFD, %"
MOTION, LEAST_MOTION = "similar vertices move %", 0.5  # in % of the diagonal
FAILING = 1e5  # number of faces above which the paper's biharmonic coordinates fail
ORDERS = 100  # the paper says that DFD binds new handles several orders of magnitude faster
METRICS = ("area %", "angle °", "edge %", "volume %")
ENCODER = "our encoder, at the same place of a picture, gives different features to left and right."
HARDWARE = "two cores instead of an NVIDIA A40."
CONSTRAINTS = {
    comparisons.FEW: "three or four fixed points hold the shape loosely, so the other method shears it as a whole. "
    "With 26 to 30 fixed points, it shears less.",
    comparisons.MANY: "between its fixed points, the other method changes the surface about as much as DFD.",
}
EQUATION = (
    "the weights of a vertex sum to more than 1, and Eq. 1 multiplies its position by the sum. So Eq. 1 as printed "
    "cannot have made the paper's figure."
)


def against(metric: str, method: str, **where: Any) -> Rule:
    """Return a rule: the mean of |`metric`| by DFD divided by that by `method`, over shapes on which `method` works.

    Only rows whose columns have the values `where` count.
    """

    def magnitude(found: Any) -> Any:
        return np.abs(found).mean()

    def number(rows: Sequence[Row]) -> float:
        some = [row for row in rows if all(row.get(key) == value for key, value in where.items())]
        shapes = [row["shape"] for row in some if row.get("method") == method and not row.get("note")]
        own, other = (column(metric, magnitude, method=each, shape=shapes)(some) for each in (OURS, method))
        return own / max(other, 1e-9)

    return number


def smooth(*methods: str) -> tuple[Claim, ...]:
    """Return for each of `methods` the claim that DFD changes angles at most as much."""
    return tuple(
        Claim(
            "as smooth as biharmonic" if method == "biharmonic" else "smoother and less global",
            f"angle change, DFD / {method}",
            against("angle °", method),
            most=1,
            cause="DFD stretches whole parts, and the other methods spread the stretch over the shape.",
        )
        for method in methods
    )


def rebind(count: int, how: str, paper: str) -> Claim:
    """Return the claim that DFD binds `count` new handles faster than OptCtrlPoints."""
    measured = f"seconds for {count} handle{'s' * (count > 1)}, OptCtrlPoints / DFD ({how})"
    return Claim(paper, measured, resolution.speedup(count, how), ORDERS, cause=HARDWARE)


FIGURES: dict[str, tuple[Claim, ...]] = {
    "fig1": (
        Claim("a plane of symmetry for every shape", PLANE, column("plane found %", preset=OURS), 100, cause=ENCODER),
    ),
    "fig2": (Claim("plausible pictures", FLIPPED, column("flipped %", preset=OURS), most=1),),
    "fig3": (
        Claim(
            "edits propagate to related parts",
            "area that follows by more than half, %",
            column("follows %", preset=OURS),
            most=50,
            cause="features of our small encoder differ less between parts.",
        ),
    ),
    "fig4": (
        Claim(
            "virtually identical fields",
            "distance of both fields / spread of the features",
            relative("mean distance", "spread", preset=OURS),
            most=0.5,
        ),
        Claim(
            "Lucy in a minute", "s to distill and bind", column("weights s", max, preset=OURS), most=60, cause=HARDWARE
        ),
    ),
    "fig5": (
        Claim(
            "score below 0.1", "largest score of a shape", column("score", max, preset=OURS), most=0.1, cause=ENCODER
        ),
    ),
    "fig6": (Claim("similar parts stay", "motion of similar parts, fixed / free", held, most=0.5),),
    "fig7": (Claim("only the horn moves", "area at λ = 32 / at λ = 0", ratio("follows %", FAR, WIDE), most=0.5),),
    "fig8": (
        Claim(
            "unrelated parts stay without fixed points",
            "motion by DFD where others have fixed points, % of the handle's",
            column("fixed points move %", **DFD),
            most=25,
            cause="features of our small encoder differ less between parts.",
        ),
    ),
    "fig9": smooth("biharmonic", "ARAP", "BBW"),
    "fig10": (
        Claim("robust to size", "longest / shortest preprocessing", column("preprocess s", spread, **DFD), most=3),
        Claim(
            "as fast as biharmonic at the lowest resolution",
            "seconds at 10³ faces, DFD / biharmonic",
            at_fewest_faces,
            most=1,
            cause="distillation takes a fixed time, and tetrahedra of a small mesh take a second. " + HARDWARE,
        ),
        Claim(
            "biharmonic fails past 10⁵ faces",
            "most faces with a result of biharmonic",
            most_faces("biharmonic"),
            most=FAILING,
        ),
        Claim(
            "scales better than all methods across all phases",
            "largest quotient of seconds, DFD / other",
            slowest_phase,
            most=1,
            cause="binding by DFD includes the forward pass at every vertex. " + HARDWARE,
        ),
        Claim("sublinear in bind", "power of growth of the binding time", growth("bind s"), most=1),
        Claim("sublinear in pose", "power of growth of the posing time", growth("pose s"), most=1),
    ),
    "fig11": (
        Claim("similar edits", "largest / smallest angle change", column("angle °", spread, preset=OURS), most=2),
    ),
    "fig12": (
        Claim(
            "similar weights", "correlation with the first encoder's weights", column("correlation", preset=OURS), 0.7
        ),
    ),
    "fig13": (
        Claim(
            "training on vertices gives much worse weights",
            "difference from weights of the fine mesh's field, trained on vertices / on all pixels",
            ratio("mean difference", VERTICES, PIXELS),
            1.5,
        ),
    ),
    "fig14": smooth("ARAP", "biharmonic", "NeuralMLS"),
    "fig15": tuple(
        Claim(
            "biharmonic coordinates and NeuralMLS degenerate",
            f"change of edges, DFD / {method}",
            against("edge %", method),
            most=1,
            cause="our weights are unique also with few handles, and training ends when handles reach their targets.",
        )
        for method in ("biharmonic", "NeuralMLS")
    ),
    "fig16": smooth("biharmonic", "ARAP", "BBW"),
    "fig17": (Claim("no tears", "mean gap, % of the largest motion", column("gap %", preset=OURS), most=5),),
    "fig18": (Claim("constant training time T", "longest / shortest T", column("T s", spread, preset=OURS), most=2),),
    "fig19": (
        Claim("the same weights", "mean difference of weights", column("mean difference", preset=OURS), most=0.1),
    ),
    "fig20": (
        Claim(
            "handles select the same parts",
            "largest / smallest area of legs",
            column("follows %", spread, preset=OURS, variant="leg"),
            most=4,
        ),
    ),
    "fig21": (
        Claim(
            "reasonable shapes",
            "diagonal of the result / of the shape",
            column("size", **DFD),
            most=1.5,
            cause=EQUATION,
        ),
    ),
    "fig22": tuple(
        Claim(
            "DFD distorts more",
            f"change of {metric.split()[0]}, DFD / {method}, {variant}",
            against(metric, method, variant=variant),
            1,
            cause=CONSTRAINTS[variant],
        )
        for variant in (comparisons.FEW, comparisons.MANY)
        for metric in METRICS
        for method in ("ARAP", "biharmonic", "NeuralMLS")
    ),
    "table1": (
        Claim(
            "every tick of Table 1",
            "ticks as in the paper, %",
            column("as in the paper, %"),
            100,
            cause="by our thresholds, ARAP moves the flank and needs little time for a new handle, and biharmonic "
            "coordinates move the other feet.",
        ),
    ),
    "table3": (
        rebind(1, "forward pass", "1,150 times as fast for 1 handle"),
        rebind(10, "forward pass", "946 times as fast for 10"),
        rebind(100, "forward pass", "641 times as fast for 100"),
        rebind(1, "features kept", "not measured"),
        rebind(100, "features kept", "not measured"),
    ),
}
PAGES: dict[str, Callable[[Context], Page]] = {
    name: getattr(module, name)
    for name in FIGURES
    for module in (controls, features, comparisons, resolution)
    if hasattr(module, name)
}
SCREENS = "it shows screenshots of the paper's user study; fig14 draws such pictures"
STUDY = "the answers of the paper's user studies are not available"
CANNOT = {"fig23": SCREENS, "fig24": SCREENS, "table2": STUDY}
