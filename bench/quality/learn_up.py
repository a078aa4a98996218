"""`python -m bench.quality.learn_up`: learn which way is up, and judge what was learned on families left out.

From all shapes in the folder that DFD_MESHES names, which stand as they should, +y up, the samples of dfd, and every
.glb and .obj in the folders of a folder given with `--also`, each of which is a family. Equal folders give equal files.

The probe that comes with the package was learned with 381 more models, converted to .glb, of Debian's megaglest-data
3.13 and 0ad-data 0.0.26 (both CC BY-SA 3.0), flightgear-data-models 2020.3 (GPL 2 or later) and sweethome3d-furniture
1.8 (CC BY 3.0 and CC0): people, animals, plants, houses, ships, machines, cars, furniture, lamps, dishes.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import dfd
from bench.quality.families import family_of
from dfd.common.files import atomic_write
from dfd.distillation.standing import Standing
from dfd.distillation.up import axis_frames
from dfd.distillation.up_probe import FOLDER, LOOKS, TERMS, UpProbe
from dfd.distillation.views_around import CORNERS, LAYERS, SIDES, Around
from dfd.encoders.encode import Encoder, load_encoder
from dfd.mesh.normalization import normalization
from dfd.runs.recipe import hash_recipe, origin

REPORT = Path(__file__).resolve().parents[1] / "results" / "quality" / "up.md"
KEPT_VIEWS = REPORT.parent / "views_around"
LOOKING = ("common", "mesh", "views", "encoders")  # the rooms whose code decides what is seen
FRAMES = np.stack(axis_frames(np.eye(3)))
TRUE = 2  # +y among them
HALF = np.concatenate([SIDES[:2], CORNERS[::2]])  # of the eyes, for shapes from --also: half the time
RIDGE = 0.1  # of the mean moment of the terms
SHRINK = 3.0  # of the odds, whose terms have unit spread
KEPT, KEPT_UP = 0.99, 0.985  # of upright files that must keep their upright axis, and their up
KEPT_OWN = 0.97  # of those in DFD_MESHES and the samples, of which many hardly have an up
Z_SHARE = 0.35  # of the log-odds of the file's y that z has: files with z up are everyday
TOGETHER = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 1.0]])  # all layers and thirds count alike
ALSO = "also/"
PRIORS, LOSSES = np.arange(0, 12, 0.05), np.arange(0, 6, 0.1)
# What a unit of the prior of +y, and of −y, adds to the six frames, see `decided`.
_FAVOR = np.array([[0, 0, 1, 0, Z_SHARE, Z_SHARE], [0, 0, 0, 1, 0, 0]])

Group = Callable[["Lesson"], str]


@dataclass(frozen=True, eq=False)
class Lesson:
    """A shape that stands as it should, and what is learned from it."""

    name: str
    seen: NDArray[np.float64]  # (6, 4, D), mean tokens of every frame, about their mean
    evidence: NDArray[np.float64]  # (6, 7), of every frame

    @property
    def family(self) -> str:
        """See `family_of`; of those from `--also` the folder they lie in."""
        folders, _, stem = self.name.rpartition("/")
        return folders.removeprefix(ALSO) if folders.startswith(ALSO) else family_of(stem)


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn, judge and write."""
    parser = argparse.ArgumentParser("python -m bench.quality.learn_up", description=__doc__)
    parser.add_argument("--encoder", default="dinov2-small")
    parser.add_argument("--output", type=Path, help="the probe's file; by default where the package looks for it")
    parser.add_argument("--also", type=Path, help="a folder of families, folders of .glb and .obj to learn from, +y up")
    options = parser.parse_args(arguments)
    if not os.environ.get("DFD_MESHES"):
        parser.error("DFD_MESHES must name the folder of meshes to learn from")
    encoder = load_encoder(options.encoder)
    lessons = []
    for name, mesh in upright_shapes(Path(os.environ["DFD_MESHES"]), options.also):
        print(name, flush=True)
        lessons.append(lesson(name, mesh, encoder))
    probe = learn(lessons, encoder)
    output = options.output or FOLDER / f"{options.encoder}.safetensors"
    output.parent.mkdir(parents=True, exist_ok=True)
    probe.save(output)
    REPORT.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(REPORT) as temporary:
        temporary.write_text(report(lessons), "utf-8")
    print(f"{output}\n{REPORT}")


def upright_shapes(folder: Path, also: Path | None = None) -> Iterator[tuple[str, dfd.Mesh]]:
    """Every shape to learn from, by name."""
    patterns = [f"{sub}*.{ending}" for sub in ("", "rigs/", "upright/") for ending in ("glb", "obj")]
    for path in sorted(path for pattern in patterns for path in folder.glob(pattern)):
        yield f"{path.parent.name}/{path.stem}", dfd.load(path)
    for make in (dfd.samples.chair, dfd.samples.quadruped, dfd.samples.robot):
        yield make.__name__, make().mesh
    if also is not None:
        for path in sorted([*also.glob("*/*.glb"), *also.glob("*/*.obj")]):
            yield f"{ALSO}{path.parent.name}/{path.stem}", dfd.load(path)


def lesson(name: str, mesh: dfd.Mesh, encoder: Encoder) -> Lesson:
    """What there is to learn from one shape."""
    center, scale = normalization(mesh)
    standing = Standing((mesh.vertices - center) * scale, mesh.faces)
    seen = look_once(mesh, encoder, HALF if name.startswith(ALSO) else np.concatenate([SIDES, CORNERS]))
    return Lesson(name, seen - seen.mean(axis=0), np.stack([standing.evidence(frame) for frame in FRAMES]))


def look_once(mesh: dfd.Mesh, encoder: Encoder, eyes: NDArray[np.float64]) -> NDArray[np.float64]:
    """`Around.seen`, kept in a file for the next time: the pictures take minutes, what follows them seconds."""
    made_of = {**origin(LOOKING, "torch"), "mesh": mesh.content_hash, "eyes": eyes.round(6).tolist()}
    kept = KEPT_VIEWS / f"{hash_recipe({**made_of, **encoder.settings()})}.npy"
    if not kept.is_file():
        KEPT_VIEWS.mkdir(parents=True, exist_ok=True)
        with atomic_write(kept) as temporary, temporary.open("wb") as stream:
            np.save(stream, Around(mesh, encoder).seen(FRAMES, eyes))
    seen: NDArray[np.float64] = np.load(kept)
    return seen


def learn(lessons: Sequence[Lesson], encoder: Encoder) -> UpProbe:
    """The probe of all lessons: odds from looks that never saw a shape's family or itself, the prior from the last."""
    rows, scales, targets, inverse = regression(tuple(lessons))
    looks = (targets.T @ inverse @ rows).reshape(len(LOOKS), len(LAYERS), -1) / scales[:, None]
    odds = fit_odds(both_terms(lessons))
    up, down = least_priors(left_out_odds(tuple(lessons), by_shape), own_names(lessons))
    settings = encoder.settings()
    return UpProbe(
        looks.astype(np.float32),
        odds,
        up,
        down,
        Z_SHARE * up,
        str(settings["encoder_weights"]),
        int(settings["encoder_block"]),
    )


def scaled(lessons: Sequence[Lesson]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rows (6 N, 4 D) of all lessons' frames, and the scale (4,) that each layer was divided by."""
    seen = np.stack([each.seen for each in lessons])
    squares = np.square(seen).sum(axis=3).mean(axis=(0, 1))
    scales = np.sqrt(TOGETHER.T @ (TOGETHER @ squares))
    return (seen / scales[:, None]).reshape(6 * len(lessons), -1), scales


def ridge(rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Targets (6 N, 2) of the ridge regression, for `LOOKS`, and the inverse (6 N, 6 N) of its kernel."""
    kernel = rows @ rows.T
    kernel += RIDGE * np.trace(kernel) / len(kernel) * np.eye(len(kernel))
    frames = np.arange(6)
    either = np.stack([frames // 2 == TRUE // 2, frames == TRUE], axis=1).astype(float)
    targets: NDArray[np.float64] = np.tile(either - either.mean(axis=0), (len(rows) // 6, 1))
    return targets, np.asarray(np.linalg.inv(kernel), np.float64)


@cache
def regression(lessons: tuple[Lesson, ...]) -> tuple[NDArray[np.float64], ...]:
    """`scaled` and `ridge` of all lessons."""
    rows, scales = scaled(lessons)
    return rows, scales, *ridge(rows)


@cache
def left_out_looks(lessons: tuple[Lesson, ...], group: Group) -> NDArray[np.float64]:
    """The `LOOKS` of every frame of every shape (N, 6, 2), by regressions that were learned without its group."""
    _, _, targets, inverse = regression(lessons)
    dual = inverse @ targets
    found = np.empty((len(lessons), 6, len(LOOKS)))
    groups = np.array([group(each) for each in lessons])
    for own in dict.fromkeys(groups):
        members = np.flatnonzero(groups == own)
        some = (6 * members[:, None] + np.arange(6)).ravel()
        # What a regression without some rows says of them follows from the one with them.
        missed = np.linalg.solve(inverse[np.ix_(some, some)], dual[some])
        found[members] = (targets[some] - missed).reshape(-1, 6, len(LOOKS))
    return found


def terms(lessons: Sequence[Lesson], looks: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """(6, 9) of every lesson, what speaks for every frame."""
    return [np.column_stack([look, each.evidence]) for look, each in zip(looks, lessons, strict=True)]


def both_terms(lessons: Sequence[Lesson]) -> list[NDArray[np.float64]]:
    """`terms` twice, by looks that never saw a shape's family, and by looks that only never saw the shape.

    What comes to be judged is sometimes of a known family and sometimes not.
    """
    return [each for group in (by_family, by_shape) for each in terms(lessons, left_out_looks(tuple(lessons), group))]


def own_names(lessons: Sequence[Lesson]) -> set[str]:
    """Those that are not from `--also`."""
    return {each.name for each in lessons if not each.name.startswith(ALSO)}


def by_family(lesson: Lesson) -> str:
    """Leave a shape's family out when it is judged."""
    return lesson.family


def by_shape(lesson: Lesson) -> str:
    """Leave the shape alone out when it is judged."""
    return lesson.name


def fit_odds(terms: Sequence[NDArray[np.float64]], start: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Log-odds (9,) by conditional logistic regression: of six candidates one is right; `start` only saves time."""
    rows = np.stack(terms)
    spread = (rows - rows.mean(axis=1, keepdims=True)).std(axis=(0, 1)) + 1e-9
    rows = rows / spread

    def loss(odds: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        scores = rows @ odds
        scores -= scores.max(axis=1, keepdims=True)
        chances = np.exp(scores)
        chances /= chances.sum(axis=1, keepdims=True)
        slope = np.einsum("nk,nkd->d", chances, rows) - rows[:, TRUE].sum(axis=0) + SHRINK * odds
        return float(-np.log(chances[:, TRUE]).sum() + SHRINK / 2 * odds @ odds), slope

    first = np.zeros(len(TERMS)) if start is None else start * spread
    odds: NDArray[np.float64] = minimize(loss, first, jac=True, method="L-BFGS-B").x / spread
    return odds


@cache
def left_out_odds(lessons: tuple[Lesson, ...], group: Group) -> dict[str, NDArray[np.float64]]:
    """Log-odds (6,) of every shape's frames, by looks and odds that were learned without its group."""
    found: dict[str, NDArray[np.float64]] = {}
    fitting, judged = both_terms(lessons), terms(lessons, left_out_looks(tuple(lessons), group))
    all_odds = fit_odds(fitting)
    for own in dict.fromkeys(map(group, lessons)):
        others = [each for each, lesson in zip(fitting, [*lessons, *lessons], strict=True) if group(lesson) != own]
        odds = fit_odds(others, all_odds)
        found |= {
            lesson.name: each @ odds for each, lesson in zip(judged, lessons, strict=True) if group(lesson) == own
        }
    return found


def decided(odds: NDArray[np.float64], up: int, priors: tuple[float, float]) -> tuple[int, int]:
    """The axis and the frame that win where frame `up` lies along the file's +y, and its z along the axis after it."""
    favored = odds.copy()
    favored[up] += priors[0]
    favored[up ^ 1] += priors[1]
    z = (up // 2 + 1) % 3
    favored[[2 * z, 2 * z + 1]] += Z_SHARE * priors[0]
    axis = int(np.logaddexp(favored[::2], favored[1::2]).argmax())
    return axis, 2 * axis + int(favored[2 * axis + 1] > favored[2 * axis])


def least_priors(odds: Mapping[str, NDArray[np.float64]], own: Collection[str] = ()) -> tuple[float, float]:
    """Log-odds of the file's +y and −y: the least of +y with which enough shapes keep their upright axis and their up.

    `KEPT` of all keep the axis, `KEPT_OWN` of `own` too, and `KEPT_UP` of all their up; −y then loses as little as
    lets them.
    """
    rows = np.stack(list(odds.values()))
    among = np.array([name in own for name in odds]) if own else np.ones(len(rows), bool)
    least = KEPT_OWN if own else 0.0

    def enough(up: float, down: float) -> bool:
        favored = rows + up * _FAVOR[0] + down * _FAVOR[1]
        axes = np.logaddexp(favored[:, ::2], favored[:, 1::2])
        upright = axes.argmax(axis=1) == TRUE // 2
        kept = upright & (favored[:, TRUE] >= favored[:, TRUE ^ 1])
        return bool(upright.mean() >= KEPT and upright[among].mean() >= least and kept.mean() >= KEPT_UP)

    pairs = ((float(up), float(up - loss)) for up in PRIORS for loss in LOSSES)
    return next((each for each in pairs if enough(*each)), (float(PRIORS[-1]), float(PRIORS[-1] - LOSSES[-1])))


def report(lessons: Sequence[Lesson]) -> str:
    """How often the right direction is found, each shape judged by what others taught."""
    priors = least_priors(left_out_odds(tuple(lessons), by_shape), own_names(lessons))
    own = [each for each in lessons if not each.name.startswith(ALSO)]
    lines = [
        "# Which way is up",
        "",
        f"{len(lessons)} shapes, of which {len(own)} are from DFD_MESHES or samples; those are judged. Log-odds of the "
        f"file's +y: {priors[0]:.2f}, of −y: {priors[1]:.2f}, of ±z: {Z_SHARE * priors[0]:.2f}. Each cell: how often "
        "the upright axis is right, and in brackets the direction.",
        "",
    ]
    for left_out, group in (("its family", by_family), ("itself", by_shape)):
        odds = left_out_odds(tuple(lessons), group)
        lines += [
            f"Each judged without {left_out}:",
            "",
            "| family | shapes | without a prior | kept upright | found z up | found, 24 turns |",
            "|---|---:|---:|---:|---:|---:|",
        ]
        for family in [*dict.fromkeys(each.family for each in own), "all"]:
            some = [odds[each.name] for each in own if family in (each.family, "all")]
            lines.append(f"| {family} | {len(some)} | {' | '.join(_shares(some, priors))} |")
        lines.append(f"| with --also | {len(odds)} | {' | '.join(_shares(list(odds.values()), priors))} |")
        wrong = [each.name for each in own if decided(odds[each.name], TRUE, (0.0, 0.0))[0] != TRUE // 2]
        lines += ["", f"Wrong axis without a prior: {', '.join(wrong)}.", ""]
    return "\n".join(lines)


def _shares(odds: Sequence[NDArray[np.float64]], priors: tuple[float, float]) -> list[str]:
    """Of shapes, right without a prior, and with it: upright, with the file's z up, and turned all ways."""

    def found(ups: Sequence[int], priors: tuple[float, float] = priors) -> str:
        # The file's +y lies along `up`, so the shape's own up is the file's z where that is the axis after it.
        all_found = [decided(each, up, priors) for each in odds for up in ups]
        right = np.mean([[axis == TRUE // 2, frame == TRUE] for axis, frame in all_found], axis=0)
        return f"{right[0]:.2f} ({right[1]:.2f})"

    return [found([TRUE], (0.0, 0.0)), found([TRUE]), found([0, 1]), found(range(6))]


if __name__ == "__main__":
    main()
