"""Rigs by rule, families, and how what was learned about up is judged."""

from __future__ import annotations

import shutil
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.quality.parts import family_of, kind_of_part, without_few
from bench.quality.shapes import Shape, rigs
from bench.quality.studies import EUCLIDEAN, FAMILIES_STUDY, TURNS, Row, turned
from bench.quality.studies import by_family as table
from bench.training import sources
from bench.training.learn_up import decided, least_priors, upright_shapes
from bench.training.up_lessons import (
    FRAMES,
    RIDGE,
    TRUE,
    UPS,
    Choice,
    Lesson,
    Odds,
    Ridge,
    Tilted,
    by_family,
    by_shape,
    fit_odds,
    learned_odds,
    learned_votes,
    left_out_choices,
    left_out_odds,
    rows_of,
)
from dfd.samples import quadruped, robot
from dfd.upright.probe import FORMS, TERMS
from dfd.upright.probe_views import ViewTokens
from dfd.upright.stability import EVIDENCE, StabilityCues


@pytest.mark.parametrize(
    ("joint", "kind"),
    [
        ("Ear1.L", "ear"),
        ("wing_feather_1_1_L", "wing"),
        ("IKFrontLeg.L", "foot"),
        ("Front_Leg_Tip_L", "foot"),
        ("FrontShoulder.L", "torso"),
        ("lowerarm_l", "arm"),
        ("BackLowerLeg.R", "leg"),
        ("mouth_tip", "head"),
        ("back_fin_0_l", "fin"),
        ("handle", "hand"),
        ("Abdomen", "torso"),
        ("Main6", "tail"),
        ("cape", None),
    ],
)
def test_kinds_of_parts(joint, kind):
    assert kind_of_part(joint) == kind


def test_parts_of_few_vertices_are_left_out():
    labels, parts = without_few(np.array([0, 0, 1, 2, 2, -1]), ("ear", "tail", "leg"), 2)
    assert labels.tolist() == [0, 0, -1, 1, 1, -1]
    assert parts == ("ear", "leg")


def test_what_is_no_rig_is_told(tmp_path):
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "bad.glb").write_bytes(b"none")
    told = []
    assert list(rigs(tmp_path, told.append)) == []
    assert told[0].startswith("bad.glb: ")


@pytest.mark.parametrize(
    ("name", "family"), [("chair_nonmanifold", "seats"), ("man", "people"), ("wolf", "four-legged"), ("rock", "rock")]
)
def test_families(name, family):
    assert family_of(name) == family


def test_turned_shapes_keep_their_parts_and_lengths():
    sample = quadruped(4000)
    shape = Shape("quadruped", sample.mesh, sample.labels, sample.parts)
    for rotation in TURNS.values():
        assert np.linalg.det(rotation) == pytest.approx(1)
        other = turned(shape, rotation)
        assert other.labels is shape.labels
        assert np.allclose(other.mesh.vertices @ rotation, shape.mesh.vertices)


def test_table_by_family_says_where_distance_is_as_good():
    rows = [
        Row(FAMILIES_STUDY, "horse", "dfd", {"precision": 0.8}),
        Row(FAMILIES_STUDY, "horse", EUCLIDEAN, {"precision": 0.6}),
        Row(FAMILIES_STUDY, "wolf", "dfd", {"precision": 0.6}),
        Row(FAMILIES_STUDY, "wolf", EUCLIDEAN, {"precision": 0.7}),
    ]
    text = table(rows)
    assert "| four-legged | 2 | 0.700 (2) | 0.650 (2) |" in text
    assert "as good on 1 of 2 shapes: wolf." in text


def test_odds_find_the_term_that_tells():
    """Among candidates of any number, of which several may be right."""
    generator = np.random.default_rng(0)
    choices = []
    for number in range(40):
        rows = generator.normal(size=(4 + number % 5, len(TERMS)))
        right = np.arange(len(rows)) < 1 + number % 2
        rows[right, 3] += 4
        choices.append(Choice(rows, right, FRAMES))
    odds = fit_odds([*choices, Choice(np.ones((3, len(TERMS))), np.zeros(3, bool), FRAMES[:3])])
    assert odds.argmax() == 3
    assert np.mean([each.right[(each.terms @ odds).argmax()] for each in choices]) > 0.9
    assert np.allclose(odds, fit_odds(choices), atol=1e-3)  # where none is right there is nothing to learn
    assert np.allclose(odds, fit_odds(choices, odds), atol=1e-3)


def unsure(along):
    """Odds of a shape that one look leaves in doubt."""
    return Odds(np.zeros((6, 6)), np.asarray(along, float))


def test_the_least_priors_keep_whatever_stands():
    """+y must come first in one's own shapes; in others it may be one of two."""
    doubtful = np.array([1.0, 0, 0, 0, 0, 0])
    up, down = least_priors({"one": doubtful}, {"one"})
    assert decided(unsure(doubtful), TRUE, (up, down)) == (TRUE // 2, TRUE)
    assert decided(unsure(doubtful), TRUE, (up - 0.2, down - 0.2))[0] != TRUE // 2
    assert least_priors({"one": doubtful}) == (0.0, 0.0)
    wrong = np.array([9.0, 0, 0, 0, 0, 0])
    assert least_priors({"one": wrong})[0] > 5


def test_own_shapes_keep_their_axis_whatever_all_do():
    """One of many may fall; not where it is one of few that count by themselves."""
    odds = {f"lessons/{number}": np.array([0, 0, 5.0, 0, 0, 0]) for number in range(200)}
    odds["own"] = np.array([4.0, 0, 0, 0, 0, 0])
    assert least_priors(odds)[0] == 0
    up, _ = least_priors(odds, {"own"})
    assert decided(unsure(odds["own"]), TRUE, (up, up))[0] == TRUE // 2


def test_the_file_up_grows_where_its_down_must_lose():
    """Here −y is likelier than +y, and the axis needs both unless +y gets more."""
    odds = {"one": np.array([2.0, 2, 0, 2.5, 0, 0])}
    up, down = least_priors(odds, {"one"})
    assert decided(unsure(odds["one"]), TRUE, (up, down)) == (TRUE // 2, TRUE)
    assert down < up


def test_one_look_decides_where_it_leaves_no_doubt():
    at_once = np.zeros((6, 6))
    at_once[4, TRUE] = 9.0
    odds = Odds(at_once, np.array([5.0, 0, 0, 0, 0, 0]))
    assert decided(odds, 4, (0.0, 0.0)) == (TRUE // 2, TRUE)
    assert decided(odds, TRUE, (0.0, 0.0)) == (0, 0)


WIDTH = 5


@cache
def lessons(count):
    """Shapes whose tokens tell by one number how much the camera's up is theirs; the rest is chance."""
    generator, mesh, made = np.random.default_rng(0), robot(4000).mesh, []

    def seen(axes, up):
        tokens = generator.normal(size=(len(axes), 2, WIDTH)).astype(np.float32)
        tokens[:, 0, 0] += 4 * (axes[:, 1] @ up)
        return ViewTokens(tokens, axes)

    for number in range(count):
        around = tuple(seen(Rotation.random(4, rng=generator).as_matrix(), UPS[TRUE]) for _ in FRAMES)
        rotation = Rotation.random(rng=generator).as_matrix()
        standing = StabilityCues(mesh.vertices @ rotation.T, mesh.faces)
        tilted = Tilted(seen(Rotation.random(24, rng=generator).as_matrix(), rotation @ UPS[TRUE]), rotation, standing)
        evidence = generator.normal(size=(len(FRAMES), len(EVIDENCE)))
        evidence[TRUE, EVIDENCE.index("middle")] += 3
        name = (
            f"lessons/rigs/{('fish', 'chair', 'tree')[number % 3]}{number}" if number % 2 else f"upright/wolf{number}"
        )
        corners = seen(Rotation.random(24, rng=generator).as_matrix(), UPS[TRUE])
        made.append(Lesson(name, around, corners, (tilted,), evidence))
    return tuple(made)


def test_rows_say_what_the_votes_of_pictures_are():
    """A probe's form and vector times the rows are its terms, but for their mean over the candidates."""
    (lesson,) = lessons(1)
    probe = learned_votes((lesson,)).without()
    form, vector = rows_of(lesson, probe.mean)
    told = probe.terms(lesson.all_seen, UPS, lesson.evidence)[:, :2]
    assert np.allclose(form.terms[:6] @ probe.form.ravel(), told[:, 0] - told[:, 0].mean(), atol=1e-5)
    assert np.allclose(vector.terms[:6] @ probe.vector.ravel(), told[:, 1] - told[:, 1].mean(), atol=1e-5)
    told = probe.terms(lesson.tilted[0].seen, lesson.tilted[0].ups, lesson.evidence)[:, :2]
    assert np.allclose(form.terms[6:] @ probe.form.ravel(), told[:, 0] - told[:, 0].mean(), atol=1e-5)
    assert form.targets[:6].tolist() == pytest.approx([-1 / 3, -1 / 3, 2 / 3, 2 / 3, -1 / 3, -1 / 3])
    assert vector.targets[:6].tolist() == pytest.approx([-1 / 6, -1 / 6, 5 / 6, -1 / 6, -1 / 6, -1 / 6])


def test_votes_without_some_are_what_the_others_teach():
    """The short cut gives what the normal equations of the others alone give."""
    some = lessons(6)
    rows = [rows_of(each, np.zeros(WIDTH, np.float32))[0] for each in some]
    ridge = Ridge(rows, len(FORMS))
    counts, terms = (np.concatenate([getattr(each, name) for each in rows]) for name in ("counts", "terms"))
    squares = np.square(terms.reshape(-1, len(FORMS), WIDTH)).sum(axis=2)
    scales = np.repeat(np.sqrt(np.average(squares, axis=0, weights=counts)), WIDTH)
    for left_out in ([], [2], [0, 5]):
        kept = [each for number, each in enumerate(rows) if number not in left_out]
        terms = np.concatenate([each.terms for each in kept]) / scales
        counts, targets = (np.concatenate([getattr(each, name) for each in kept]) for name in ("counts", "targets"))
        moment = terms.T @ (counts[:, None] * terms) + RIDGE * len(FORMS) * np.eye(terms.shape[1])
        direct = np.linalg.solve(moment, terms.T @ (counts * targets)) / scales
        assert np.allclose(ridge.without([rows[number] for number in left_out]).ravel(), direct, rtol=1e-4, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("group", [by_shape, by_family])
def test_what_is_learned_finds_shapes_that_it_never_saw(group):
    some = lessons(16)
    odds = left_out_odds(some, group)
    assert set(odds) == {each.name for each in some}
    assert np.mean([each.along.argmax() == TRUE for each in odds.values()]) > 0.8
    assert learned_odds(some).shape == (3, len(TERMS))


def test_a_tilted_shape_is_judged_by_candidates_near_its_up():
    some = lessons(4)
    told = left_out_choices(some, by_shape)[some[0].name]
    (choice,) = told.tilted
    assert choice.terms.shape == (len(choice.right), len(TERMS))
    assert 0 < choice.right.sum() <= len(choice.right) // 2


def test_further_shapes_are_few_of_a_kind_and_have_an_up(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "MOST_ALIKE", 1)
    (tmp_path / "meshes").mkdir()
    things = tmp_path / "lessons" / "upright"
    things.mkdir(parents=True)
    robot(4000).mesh.save(things / "some_pack_jar1.glb")
    for name in ("some_pack_jar2", "some_pack_jar3", "some_pack_tree", "other_pack_jar", "a_bone"):
        shutil.copy(things / "some_pack_jar1.glb", things / f"{name}.glb")
    shutil.copy(things / "some_pack_jar1.glb", tmp_path / "meshes" / "of_another_license.glb")
    names = [name for name, _ in upright_shapes(tmp_path / "meshes", tmp_path / "lessons")]
    further = ("other_pack_jar", "some_pack_tree")
    assert names == [*(f"lessons/upright/{each}" for each in further), "chair", "quadruped", "robot"]
