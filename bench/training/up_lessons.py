"""What is learned about which way is up: votes of pictures by ridge regression, their odds by logistic regression."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter

import numpy as np
from scipy.optimize import minimize

from bench.quality.parts import family_of
from dfd.common.linear_algebra import Bool, Float32, Float64
from dfd.upright.candidates import axis_frames
from dfd.upright.find_up import candidates
from dfd.upright.probe import FORM_TOKENS, FORMS, TERMS, VECTOR_TOKENS, VECTORS, UpProbe
from dfd.upright.probe_views import ViewTokens
from dfd.upright.stability import StabilityCues

FRAMES = np.stack(axis_frames(np.eye(3)))
UPS = FRAMES[:, 1]
TRUE = 2  # +y among them
LESSONS = "lessons/"  # what names of shapes that are not from DFD_MESHES begin with
RIDGE = 1.0  # of the mean moment of the terms
SHRINK = 3.0  # of the odds, whose terms have unit spread
FOLDS = 16
NEAR = np.cos(np.radians(20))  # of a tilted shape a candidate so near to its up is right
TILTED = 0.5  # what pictures along random axes count, beside those along the shape's own

Group = Callable[["UpLesson"], str]


@dataclass(frozen=True, eq=False)
class Tilted:
    """A shape turned at random: what is seen from around the axes of its file, and how it would stand."""

    seen: ViewTokens
    rotation: Float64  # (3, 3) from where it stands upright
    standing: StabilityCues

    @property
    def ups(self) -> Float64:
        """(6, 3) where those of `FRAMES` have come to lie."""
        return UPS @ self.rotation.T


@dataclass(frozen=True, eq=False)
class UpLesson:
    """A shape that stands as it should, +y up, and what is learned from it."""

    name: str
    sides: tuple[ViewTokens, ...]  # of each of `FRAMES`
    corners: ViewTokens  # of all of them
    tilted: tuple[Tilted, ...]
    evidence: Float64  # (6, 7), of every frame

    @property
    def family(self) -> str:
        """See `family_of`."""
        return family_of(self.name.rpartition("/")[2])

    @property
    def all_seen(self) -> ViewTokens:
        """All pictures along its own axes."""
        return sum(self.sides, self.corners)


# What is left out when a shape is judged: its family, or itself.
by_family, by_shape = attrgetter("family"), attrgetter("name")


@dataclass(frozen=True, eq=False)
class Rows:
    """What a linear vote is learned from, of M rows."""

    terms: Float64  # (M, J D) for every up of a shape, what J numbers of D weights each are multiplied by
    # targets, counts: (M,) what the vote should be, and how much that counts
    targets: Float64
    counts: Float64


def rows_of(lesson: UpLesson, mean: Float32) -> tuple[Rows, Rows]:
    """For the form, which tells the upright axis, and for the vector, which tells its end; all about their means."""
    forms, vectors = [], []
    for seen, ups in ((lesson.all_seen, UPS), *((each.seen, each.ups) for each in lesson.tilted)):
        tokens = seen.tokens - np.stack([mean, np.zeros_like(mean)])
        ups = np.einsum("nai,ki->nka", seen.axes, ups)
        at_ups = np.einsum("nka,jab,nkb->nkj", ups, FORMS, ups, optimize=True)
        forms.append(np.einsum("nkj,njd->kjd", at_ups, tokens[:, FORM_TOKENS], optimize=True) / len(tokens))
        at_ups = np.einsum("nka,ja->nkj", ups, VECTORS)
        vectors.append(np.einsum("nkj,njd->kjd", at_ups, tokens[:, VECTOR_TOKENS], optimize=True) / len(tokens))
    frames = np.arange(len(FRAMES))
    counts = np.repeat([1.0] + [TILTED] * len(lesson.tilted), len(frames))

    def made(terms: list[Float64], right: Bool) -> Rows:
        about = np.concatenate([(each - each.mean(axis=0)).reshape(len(frames), -1) for each in terms])
        return Rows(about, np.tile(right - right.mean(), len(terms)), counts)

    return made(forms, frames // 2 == TRUE // 2), made(vectors, frames == TRUE)


class Ridge:
    """A linear vote by ridge regression, of all rows or of all but some.

    Every one of the J blocks of terms counts alike, whatever its tokens' spread.
    """

    def __init__(self, rows: Sequence[Rows], blocks: int) -> None:
        self._blocks, size = blocks, rows[0].terms.shape[1]
        squares = sum(each.counts @ np.square(each.terms) for each in rows).reshape(blocks, -1).sum(axis=1)
        spread = squares / sum(each.counts.sum() for each in rows)
        self._scales = np.sqrt(np.maximum(spread, np.finfo(np.float64).tiny)).repeat(size // blocks)
        moment, told = self._moments(rows)
        self._moment, self._told = moment + RIDGE * blocks * np.eye(size), told

    def _moments(self, rows: Sequence[Rows]) -> tuple[Float64, Float64]:
        moment, told = np.zeros((len(self._scales),) * 2), np.zeros(len(self._scales))
        for each in rows:
            terms = each.terms / self._scales
            moment += terms.T @ (each.counts[:, None] * terms)
            told += terms.T @ (each.counts * each.targets)
        return moment, told

    def without(self, some: Sequence[Rows] = ()) -> Float32:
        """Return the vote (J, D) that all rows but `some` teach."""
        moment, told = self._moments(some)
        weights = np.linalg.solve(self._moment - moment, self._told - told) / self._scales
        return weights.reshape(self._blocks, -1).astype(np.float32)


class Votes:
    """What pictures teach: probes that vote, without odds."""

    def __init__(self, lessons: Sequence[UpLesson]) -> None:
        tokens = [lesson.all_seen.tokens[:, 0].mean(axis=0) for lesson in lessons]
        self._mean: Float32 = np.stack(tokens).mean(axis=0, dtype=np.float64).astype(np.float32)
        self._rows = {lesson.name: rows_of(lesson, self._mean) for lesson in lessons}
        self._form = Ridge([form for form, _ in self._rows.values()], len(FORMS))
        self._vector = Ridge([vector for _, vector in self._rows.values()], len(VECTORS))

    def without(self, names: Sequence[str] = ()) -> UpProbe:
        """The probe that all lessons but those of `names` teach."""
        some = [self._rows[name] for name in names]
        form = self._form.without([each for each, _ in some])
        vector = self._vector.without([each for _, each in some])
        return UpProbe(self._mean, form, vector, np.zeros((3, len(TERMS))), 0.0, 0.0, 0.0, "", 0)


@cache
def learned_votes(lessons: tuple[UpLesson, ...]) -> Votes:
    """What all lessons teach."""
    return Votes(lessons)


@dataclass(frozen=True, eq=False)
class Choice:
    """What speaks for each of K candidates, and which of them are right."""

    terms: Float64  # (K, 9)
    right: Bool  # (K,)
    frames: Float64  # (K, 3, 3)


@dataclass(frozen=True, eq=False)
class Choices:
    """Those of a shape: by one look around each of `FRAMES`, by all looks, and where it is tilted."""

    at_once: tuple[Choice, ...]
    along: Choice
    tilted: tuple[Choice, ...]


def choices(lesson: UpLesson, probe: UpProbe) -> Choices:
    """What `probe` and the surface say of a lesson's shape."""
    upright = np.arange(len(FRAMES)) == TRUE

    def of_tilted(each: Tilted) -> Choice:
        frames = candidates(each.standing, each.standing.frame(), probe.votes(each.seen)[0])
        evidence = np.stack([each.standing.evidence(frame) for frame in frames])
        found = probe.terms(each.seen, frames[:, 1], evidence)
        return Choice(found, frames[:, 1] @ each.ups[TRUE] > NEAR, frames)

    return Choices(
        tuple(Choice(probe.terms(each, UPS, lesson.evidence), upright, FRAMES) for each in lesson.sides),
        Choice(probe.terms(lesson.all_seen, UPS, lesson.evidence), upright, FRAMES),
        # What has come to lie along the axes of a file after all is not looked at as tilted.
        tuple(of_tilted(each) for each in lesson.tilted if not np.array_equal(each.standing.frame(), np.eye(3))),
    )


@cache
def left_out_choices(lessons: tuple[UpLesson, ...], group: Group) -> dict[str, Choices]:
    """`choices` of every shape by votes that were learned without its group."""
    votes = learned_votes(lessons)
    found: dict[str, Choices] = {}
    for own in dict.fromkeys(map(group, lessons)):
        members = [each for each in lessons if group(each) == own]
        probe = votes.without([each.name for each in members])
        found |= {each.name: choices(each, probe) for each in members}
    return found


def learned_odds(lessons: tuple[UpLesson, ...], without: Collection[str] = ()) -> Float64:
    """(3, 9) see `UpProbe.odds`, of all lessons but those of some names.

    From votes that never saw a shape's family, and from votes that only never saw the shape: what comes to be judged
    is sometimes of a known family and sometimes not.
    """
    some = [
        left_out_choices(lessons, group)[each.name]
        for group in (by_family, by_shape)
        for each in lessons
        if each.name not in without
    ]
    kinds = (
        [choice for each in some for choice in each.at_once],
        [each.along for each in some],
        [choice for each in some for choice in each.tilted],
    )
    return np.stack([fit_odds(kind) for kind in kinds])


def fit_odds(choices: Sequence[Choice]) -> Float64:
    """Log-odds (T,) of what speaks for candidates, by conditional logistic regression: one of the right ones is chosen.

    Choices of which none is right teach nothing: without any others the odds are 0.
    """
    taught = [each for each in choices if each.right.any()]
    if not taught:
        return np.zeros(len(TERMS))
    begin = np.cumsum([0, *(len(each.right) for each in taught[:-1])])
    size = [len(each.right) for each in taught]
    right = np.concatenate([each.right for each in taught])
    rows = np.concatenate([each.terms - each.terms.mean(axis=0) for each in taught])
    spread = rows.std(axis=0) + 1e-9
    rows = rows / spread

    def loss(odds: Float64) -> tuple[float, Float64]:
        scores = rows @ odds
        chances = np.exp(scores - np.repeat(np.maximum.reduceat(scores, begin), size))
        chances /= np.repeat(np.add.reduceat(chances, begin), size)
        of_right = np.add.reduceat(chances * right, begin)
        slope = rows.T @ (chances - chances * right / np.repeat(of_right, size)) + SHRINK * odds
        return float(-np.log(of_right).sum() + SHRINK / 2 * odds @ odds), slope

    odds: Float64 = minimize(loss, np.zeros(rows.shape[1]), jac=True, method="L-BFGS-B").x / spread
    return odds


@dataclass(frozen=True, eq=False)
class Odds:
    """Log-odds of the candidates of a shape, see `Choices`."""

    at_once: Float64  # (6, 6)
    along: Float64  # (6,)


@cache
def left_out_odds(lessons: tuple[UpLesson, ...], group: Group) -> dict[str, Odds]:
    """Log-odds of every shape's candidates, by votes that were learned without its group, and odds without its fold.

    A fold is some groups: nine numbers hardly know one of hundreds of shapes.
    """
    found: dict[str, Odds] = {}
    groups = list(dict.fromkeys(map(group, lessons)))
    for fold in (set(groups[first::FOLDS]) for first in range(FOLDS)):
        names = {each.name for each in lessons if group(each) in fold}
        at_once, along, _ = learned_odds(lessons, names)
        for each in lessons:
            if each.name in names:
                told = left_out_choices(lessons, group)[each.name]
                looks = np.stack([choice.terms @ at_once for choice in told.at_once])
                found[each.name] = Odds(looks, told.along.terms @ along)
    return found
