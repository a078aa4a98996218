"""Learn an `UpProbe`: its votes by ridge regression, and its odds by logistic regression.

Odds weight nine terms: two votes, linear in the tokens (feature vectors) of pictures, and seven cues of the surface.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from scipy.optimize import minimize

from bench.quality.parts import family_of
from dfd.common.linear_algebra import Bool, Float64
from dfd.upright.candidates import axis_frames
from dfd.upright.find_up import candidates
from dfd.upright.probe import FORM_TOKENS, FORMS, TERMS, VECTOR_TOKENS, VECTORS, UpProbe
from dfd.upright.probe_views import ViewTokens
from dfd.upright.stability import StabilityCues

FRAMES = np.stack(axis_frames(np.eye(3)))  # (6, 3, 3) right, up and front, for each signed coordinate axis as up
UPS = FRAMES[:, 1]
TRUE = 2  # index of +y, the true up, in `UPS`
LESSONS = "lessons/"  # prefix of the names of shapes from the folder `--lessons`
RIDGE = 1.0  # ridge penalty for each of the J blocks of terms, which are scaled to equal mean square
SHRINK = 3.0  # penalty on the squared odds, for terms that are scaled to standard deviation 1
FOLDS = 16  # number of folds in `left_out_odds`
NEAR = np.cos(np.radians(20))  # cosine of the largest angle between a correct candidate and the true up direction
TILTED = 0.5  # weight of a randomly rotated shape in the ridge regression; the upright shape has weight 1

Choice = tuple[Float64, Bool]  # the terms (K, 9) of K candidates for up, and a mask (K,) of the correct ones
# Choices for one shape: for the pictures of each of `FRAMES` alone, for all pictures, and for the tilted shape.
Choices = tuple[list[Choice], list[Choice], list[Choice]]


@dataclass(frozen=True, eq=False)
class UpLesson:
    """The data of one training shape with up +y, and of a tilted (randomly rotated) copy: picture tokens and cues."""

    name: str
    sides: tuple[ViewTokens, ...]  # tokens of the pictures from the directions `SIDES`, for each of `FRAMES`
    corners: ViewTokens  # tokens of the pictures from the directions `CORNERS`, for all of `FRAMES`
    evidence: Float64  # (6, 7) cues of the surface for each of `FRAMES`, see `StabilityCues.evidence`
    rotation: Float64  # (3, 3) rotates the upright shape to the tilted one
    tilted: ViewTokens  # tokens of pictures of the tilted shape from `SIDES`, for each of `FRAMES`
    tilted_cues: StabilityCues  # cues of the tilted surface

    @property
    def family(self) -> str:
        """Return the family of the shape, see `family_of`."""
        return family_of(self.name.rpartition("/")[2])

    @property
    def all_seen(self) -> ViewTokens:
        """Return the tokens of all pictures of the upright shape."""
        return sum(self.sides, self.corners)

    @property
    def tilted_ups(self) -> Float64:
        """Return the up directions (6, 3) of `FRAMES`, rotated with the tilted shape."""
        return UPS @ self.rotation.T


Group = Literal["family", "name"]  # a shape is tested without the lessons of its family, or without its own lesson


class Ridge:
    """Learn one vote by ridge regression, from all lessons or without some of them.

    A vote has J coefficients, each linear in D token values. So its terms form J blocks, which are scaled equally.
    """

    def __init__(self, terms: Float64, right: Bool, blocks: int) -> None:
        """Store terms (L, 12, J D) for six ups of L shapes, upright and tilted. `right` (6,) marks the correct ups."""
        weights = np.repeat([1.0, TILTED], len(FRAMES))
        mean_squares = np.einsum("n,lnd->d", weights, np.square(terms)) / (len(terms) * weights.sum())
        block_squares = mean_squares.reshape(blocks, -1).sum(axis=1)
        self._scales = np.sqrt(np.maximum(block_squares, 1e-300)).repeat(terms.shape[2] // blocks)
        self._terms = terms / self._scales * np.sqrt(weights)[:, None]
        self._targets, self._blocks = np.tile(right - right.mean(), 2) * np.sqrt(weights), blocks
        moment, self._products = self._moments(range(len(terms)))
        self._moment = moment + RIDGE * blocks * np.eye(len(moment))

    def _moments(self, lessons: Sequence[int]) -> tuple[Float64, Float64]:
        rows = self._terms[lessons].reshape(-1, len(self._scales))
        return rows.T @ rows, rows.T @ np.tile(self._targets, len(lessons))

    def without(self, lessons: Sequence[int]) -> Float64:
        """Return the map (J, D) from tokens to coefficients, learned without the lessons with the indices `lessons`."""
        moment, products = self._moments(lessons)
        weights = np.linalg.solve(self._moment - moment, self._products - products) / self._scales
        return weights.reshape(self._blocks, -1).astype(np.float32)


class Votes:
    """Learn the two votes of a probe: a quadratic form for the upright axis, and a vector for its upper end."""

    def __init__(self, lessons: Sequence[UpLesson]) -> None:
        tokens = [lesson.all_seen.tokens[:, 0].mean(axis=0) for lesson in lessons]
        self._mean = np.stack(tokens).mean(axis=0, dtype=np.float64).astype(np.float32)
        self._names = [lesson.name for lesson in lessons]
        forms, vectors = zip(*map(self._terms, lessons), strict=True)
        frames = np.arange(len(FRAMES))
        self._form = Ridge(np.stack(forms), frames // 2 == TRUE // 2, len(FORMS))
        self._vector = Ridge(np.stack(vectors), frames == TRUE, len(VECTORS))

    def _terms(self, lesson: UpLesson) -> tuple[Float64, Float64]:
        """Return the terms (12, J D) of the form and of the vector, each minus its mean over six ups."""
        forms, vectors = [], []
        for seen, ups in ((lesson.all_seen, UPS), (lesson.tilted, lesson.tilted_ups)):
            tokens = seen.tokens - np.stack([self._mean, np.zeros_like(self._mean)])
            ups = np.einsum("nai,ki->nka", seen.axes, ups)
            at_ups = np.einsum("nka,jab,nkb->nkj", ups, FORMS, ups, optimize=True)
            forms.append(np.einsum("nkj,njd->kjd", at_ups, tokens[:, FORM_TOKENS], optimize=True) / len(tokens))
            at_ups = np.einsum("nka,ja->nkj", ups, VECTORS)
            vectors.append(np.einsum("nkj,njd->kjd", at_ups, tokens[:, VECTOR_TOKENS], optimize=True) / len(tokens))
        form, vector = ((terms - np.mean(terms, axis=1, keepdims=True)) for terms in (forms, vectors))
        return form.reshape(2 * len(UPS), -1), vector.reshape(2 * len(UPS), -1)

    def without(self, names: Collection[str] = ()) -> UpProbe:
        """Return the probe with votes learned without the lessons of `names`. Its odds are 0."""
        left_out = [index for index, name in enumerate(self._names) if name in names]
        form, vector = self._form.without(left_out), self._vector.without(left_out)
        return UpProbe(self._mean, form, vector, np.zeros((3, len(TERMS))), 0.0, 0.0, 0.0, "", 0)


learned_votes = cache(Votes)


def choices(lesson: UpLesson, probe: UpProbe) -> Choices:
    """Return the choices for a lesson's shape, with terms from the votes of `probe` and the cues of the surface."""
    upright = np.arange(len(FRAMES)) == TRUE
    tilted = []
    cues = lesson.tilted_cues
    if not np.array_equal(cues.frame(), np.eye(3)):  # otherwise, the axes of the cues are those of the file
        frames = candidates(cues, cues.frame(), probe.votes(lesson.tilted)[0])
        evidence = np.stack([cues.evidence(frame) for frame in frames])
        terms = probe.terms(lesson.tilted, frames[:, 1], evidence)
        tilted.append((terms, frames[:, 1] @ lesson.tilted_ups[TRUE] > NEAR))
    alone = [(probe.terms(each, UPS, lesson.evidence), upright) for each in lesson.sides]
    return alone, [(probe.terms(lesson.all_seen, UPS, lesson.evidence), upright)], tilted


@cache
def left_out_choices(lessons: tuple[UpLesson, ...], group: Group) -> dict[str, Choices]:
    """Return the `choices` of every shape, by name, with votes that were learned without its group."""
    votes = learned_votes(lessons)
    found: dict[str, Choices] = {}
    for own in dict.fromkeys(getattr(each, group) for each in lessons):
        members = [each for each in lessons if getattr(each, group) == own]
        probe = votes.without([each.name for each in members])
        found |= {each.name: choices(each, probe) for each in members}
    return found


def learned_odds(lessons: tuple[UpLesson, ...], without: Collection[str] = ()) -> Float64:
    """Return `UpProbe.odds` (3, 9), learned without the lessons that `without` names.

    Each shape is used twice: with votes learned without its family, and with votes learned without this shape alone. So
    the odds fit new shapes of unknown and of known families.
    """
    some = [
        left_out_choices(lessons, group)[each.name]
        for group in ("family", "name")
        for each in lessons
        if each.name not in without
    ]
    return np.stack([fit_odds([choice for each in kind for choice in each]) for kind in zip(*some, strict=True)])


def fit_odds(choices: Sequence[Choice]) -> Float64:
    """Return the odds (9,), log-odds per unit of each term, by conditional logistic regression.

    Choices without a correct candidate are ignored. If no choice remains, the odds are 0.
    """
    taught = [(terms, right) for terms, right in choices if right.any()]
    if not taught:
        return np.zeros(len(TERMS))
    begin = np.cumsum([0, *(len(right) for _, right in taught[:-1])])
    right = np.concatenate([right for _, right in taught])
    rows = np.concatenate([terms - terms.mean(axis=0) for terms, _ in taught])
    spread = rows.std(axis=0) + 1e-9
    rows = rows / spread

    def loss(odds: Float64) -> float:
        scores = rows @ odds
        all_candidates, right_ones = (
            np.logaddexp.reduceat(each, begin).sum() for each in (scores, np.where(right, scores, -np.inf))
        )
        return float(all_candidates - right_ones + SHRINK / 2 * odds @ odds)

    return np.asarray(minimize(loss, np.zeros(rows.shape[1])).x / spread)


@cache
def left_out_odds(lessons: tuple[UpLesson, ...], group: Group) -> dict[str, Float64]:
    """Return, by name, log-odds (7, 6) of every shape's six candidates for up, from votes learned without its group.

    Row i of the first six uses only the pictures of `FRAMES[i]`. The last row uses all pictures. To save time, odds are
    learned without a whole fold of groups, one of which is the shape's.
    """
    found: dict[str, Float64] = {}
    groups = list(dict.fromkeys(getattr(each, group) for each in lessons))
    for fold in (set(groups[first::FOLDS]) for first in range(FOLDS)):
        names = [each.name for each in lessons if getattr(each, group) in fold]
        odds_alone, odds_together, _ = learned_odds(lessons, names)
        for name in names:
            alone, together, _ = left_out_choices(lessons, group)[name]
            found[name] = np.stack([*(terms @ odds_alone for terms, _ in alone), together[0][0] @ odds_together])
    return found
