"""`python -m bench.quality.learn_up`: learn which way is up, and judge what was learned on families left out.

From all shapes in the folder that DFD_MESHES names, which stand as they should, +y up, and the samples of dfd. Equal
folders give equal files.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import dfd
from bench.quality.families import family_of
from dfd.common.files import atomic_write
from dfd.distillation.side_views import SideViews, look_from_sides
from dfd.distillation.standing import Standing
from dfd.distillation.up import axis_frames
from dfd.distillation.up_probe import FOLDER, TERMS, UpProbe, directions
from dfd.encoders.encode import Encoder, load_encoder
from dfd.mesh.normalization import normalization
from dfd.runs.recipe import hash_recipe, origin

REPORT = Path(__file__).resolve().parents[1] / "results" / "quality" / "up.md"
KEPT_VIEWS = REPORT.parent / "side_views"
LOOKING = ("common", "mesh", "views", "encoders")  # the rooms whose code decides what is seen
FRAMES = np.stack(axis_frames(np.eye(3)))
TRUE = 2  # +y among them
RIDGE = 0.01  # of the mean moment of the tokens
SHRINK = 10.0  # of the odds, whose terms have unit spread
KEPT = 0.98  # of the upright files that must keep their up
Z_SHARE = 0.25  # of the log-odds of the file's +y that ±z has: files with z up are everyday

Group = Callable[["Lesson"], str]
Maps = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Lesson:
    """A shape that stands as it should, and what is learned from it."""

    name: str
    seen: SideViews
    evidence: NDArray[np.float64]  # (6, 6), of every frame
    moments: NDArray[np.float64]  # (D + 1, D + 1)
    targets: NDArray[np.float64]  # (D + 1, 4): up in the picture, and height

    @property
    def family(self) -> str:
        """See `family_of`."""
        return family_of(self.name.rpartition("/")[2])

    def terms(self, maps: Maps) -> NDArray[np.float64]:
        """(6, 8) what speaks for every frame."""
        pointing, rising = directions(self.seen, *maps)
        ups = FRAMES[:, 1]
        return np.concatenate([(ups @ pointing)[:, None], (ups @ rising)[:, None], self.evidence], axis=1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn, judge and write."""
    parser = argparse.ArgumentParser("python -m bench.quality.learn_up", description=__doc__)
    parser.add_argument("--encoder", default="dinov2-small")
    parser.add_argument("--output", type=Path, help="the probe's file; by default where the package looks for it")
    options = parser.parse_args(arguments)
    if not os.environ.get("DFD_MESHES"):
        parser.error("DFD_MESHES must name the folder of meshes to learn from")
    encoder = load_encoder(options.encoder)
    lessons = []
    for name, mesh in upright_shapes(Path(os.environ["DFD_MESHES"])):
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


def upright_shapes(folder: Path) -> list[tuple[str, dfd.Mesh]]:
    """Every shape to learn from, by name."""
    patterns = [f"{sub}*.{ending}" for sub in ("", "rigs/", "upright/") for ending in ("glb", "obj")]
    paths = [path for pattern in patterns for path in folder.glob(pattern)]
    samples = [(make.__name__, make().mesh) for make in (dfd.samples.chair, dfd.samples.quadruped, dfd.samples.robot)]
    return [(f"{path.parent.name}/{path.stem}", dfd.load(path)) for path in sorted(paths)] + samples


def lesson(name: str, mesh: dfd.Mesh, encoder: Encoder) -> Lesson:
    """What there is to learn from one shape."""
    center, scale = normalization(mesh)
    standing = Standing((mesh.vertices - center) * scale, mesh.faces)
    seen = look_once(mesh, encoder)
    rows = seen.tokens.astype(np.float64)
    weighted = rows * seen.weight[:, None]
    up_in_picture = seen.axes[seen.picture] @ FRAMES[TRUE, 1]
    targets = np.concatenate([up_in_picture, seen.place[:, 1:2]], axis=1)
    evidence = np.stack([standing.evidence(frame) for frame in FRAMES])
    return Lesson(name, seen, evidence, weighted.T @ rows, weighted.T @ targets)


def look_once(mesh: dfd.Mesh, encoder: Encoder) -> SideViews:
    """`look_from_sides`, kept in a file for the next time: the pictures take minutes, what follows them seconds."""
    kept = (
        KEPT_VIEWS / f"{hash_recipe({**origin(LOOKING, 'torch'), 'mesh': mesh.content_hash, **encoder.settings()})}.npz"
    )
    if not kept.is_file():
        seen = look_from_sides(mesh, encoder, np.eye(3))
        KEPT_VIEWS.mkdir(parents=True, exist_ok=True)
        with atomic_write(kept) as temporary, temporary.open("wb") as stream:
            np.savez(stream, **vars(seen))
    with np.load(kept) as arrays:
        return SideViews(**arrays)


def learn(lessons: Sequence[Lesson], encoder: Encoder) -> UpProbe:
    """The probe of all lessons: odds from maps that never saw a shape's family, the prior from each left out."""
    terms = crossed(lessons, by_family)
    odds = fit_odds([terms[each.name] for each in lessons])
    towards_up, height = fit_maps(lessons)
    file_up = least_prior(left_out_odds(lessons, by_shape))
    settings = encoder.settings()
    return UpProbe(
        towards_up.astype(np.float32),
        height.astype(np.float32),
        odds,
        file_up,
        Z_SHARE * file_up,
        str(settings["encoder_weights"]),
        int(settings["encoder_block"]),
    )


def fit_maps(lessons: Sequence[Lesson]) -> Maps:
    """Ridge regressions from tokens to up in the picture, (D + 1, 3), and to height, (D + 1,)."""
    moments = np.sum([each.moments for each in lessons], axis=0)
    moments += RIDGE * np.trace(moments) / len(moments) * np.eye(len(moments))
    maps = np.linalg.solve(moments, np.sum([each.targets for each in lessons], axis=0))
    return maps[:, :3], maps[:, 3]


def by_family(lesson: Lesson) -> str:
    """Leave a shape's family out when it is judged."""
    return lesson.family


def by_shape(lesson: Lesson) -> str:
    """Leave the shape alone out when it is judged."""
    return lesson.name


def crossed(lessons: Sequence[Lesson], group: Group) -> dict[str, NDArray[np.float64]]:
    """Terms of every shape, by maps that were learned without its group."""
    found = {}
    for own in dict.fromkeys(map(group, lessons)):
        maps = fit_maps([each for each in lessons if group(each) != own])
        found |= {each.name: each.terms(maps) for each in lessons if group(each) == own}
    return found


def fit_odds(terms: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log-odds (8,) by conditional logistic regression: of six candidates one is right."""
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

    odds: NDArray[np.float64] = minimize(loss, np.zeros(len(TERMS)), jac=True, method="L-BFGS-B").x / spread
    return odds


def left_out_odds(lessons: Sequence[Lesson], group: Group) -> dict[str, NDArray[np.float64]]:
    """Log-odds (6,) of every shape's frames, by maps and odds that were learned without its group."""
    found = {}
    terms = crossed(lessons, group)
    for own in dict.fromkeys(map(group, lessons)):
        odds = fit_odds([terms[each.name] for each in lessons if group(each) != own])
        found |= {each.name: terms[each.name] @ odds for each in lessons if group(each) == own}
    return found


def with_prior(odds: NDArray[np.float64], up: int, prior: float) -> int:
    """The frame that wins where frame `up` lies along the file's +y, and the file's ±z along the axis after it."""
    favored = odds.copy()
    favored[up] += prior
    axis = (up // 2 + 1) % 3
    favored[[2 * axis, 2 * axis + 1]] += Z_SHARE * prior
    return int(favored.argmax())


def least_prior(odds: Mapping[str, NDArray[np.float64]]) -> float:
    """The least log-odds for the file's +y with which `KEPT` of the shapes keep it."""
    for prior in np.arange(0, 10, 0.1):
        if np.mean([with_prior(each, TRUE, prior) == TRUE for each in odds.values()]) >= KEPT:
            return float(prior)
    return 10.0


def report(lessons: Sequence[Lesson]) -> str:
    """How often the right direction is found, each shape judged by what others taught."""
    prior = least_prior(left_out_odds(lessons, by_shape))
    lines = [
        "# Which way is up",
        "",
        f"{len(lessons)} shapes. Log-odds of the file's +y: {prior:.1f}, the least with which {KEPT:.0%} keep it, "
        f"each left out; of ±z {Z_SHARE:g} of that.",
        "",
    ]
    for left_out, group in (("its family", by_family), ("itself", by_shape)):
        odds = left_out_odds(lessons, group)
        lines += [
            f"Each judged without {left_out}:",
            "",
            "| family | shapes | without a prior | kept upright | found z up | found turned |",
            "|---|---:|---:|---:|---:|---:|",
        ]
        for family in [*dict.fromkeys(each.family for each in lessons), "all"]:
            own = [odds[each.name] for each in lessons if family in (each.family, "all")]
            lines.append(f"| {family} | {len(own)} | {' | '.join(_shares(own, prior))} |")
        wrong = [name for name, each in odds.items() if each.argmax() != TRUE]
        lines += ["", f"Wrong without a prior: {', '.join(wrong)}.", ""]
        lines += [
            "| log-odds of +y | without | kept upright | found z up | found turned |",
            "|---:|---:|---:|---:|---:|",
        ]
        lines += [f"| {each} | {' | '.join(_shares(list(odds.values()), each))} |" for each in range(7)]
        lines.append("")
    return "\n".join(lines)


def _shares(odds: Sequence[NDArray[np.float64]], prior: float) -> list[str]:
    """Of shapes: right without a prior, kept upright with it, found with z up, found with any other axis up."""

    def found(ups: Sequence[int]) -> float:
        # The file's +y lies along `up`, so the shape's own up is the file's z where that is the axis after it.
        return float(np.mean([with_prior(each, up, prior) == TRUE for each in odds for up in ups]))

    alone = float(np.mean([each.argmax() == TRUE for each in odds]))
    return [f"{share:.2f}" for share in (alone, found([TRUE]), found([0, 1]), found([0, 1, 3, 4, 5]))]


if __name__ == "__main__":
    main()
