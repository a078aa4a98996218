"""Rigs by rule, families, and how what was learned about up is judged."""

from __future__ import annotations

import numpy as np
import pytest

from bench.quality.families import family_of
from bench.quality.learn_up import (
    FRAMES,
    TRUE,
    Lesson,
    both_terms,
    by_family,
    by_shape,
    decided,
    fit_odds,
    least_priors,
    left_out_looks,
    left_out_odds,
    ridge,
    scaled,
    upright_shapes,
)
from bench.quality.parts import kind_of_part, without_few
from bench.quality.shapes import Shape, rigs
from bench.quality.studies import Row
from bench.quality.upright import EUCLIDEAN, STUDY, TURNS, turned
from bench.quality.upright import by_family as table
from dfd.distillation.standing import EVIDENCE
from dfd.distillation.up_probe import LOOKS, TERMS
from dfd.distillation.views_around import LAYERS
from dfd.samples import quadruped, robot


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
        Row(STUDY, "horse", "dfd", {"precision": 0.8}),
        Row(STUDY, "horse", EUCLIDEAN, {"precision": 0.6}),
        Row(STUDY, "wolf", "dfd", {"precision": 0.6}),
        Row(STUDY, "wolf", EUCLIDEAN, {"precision": 0.7}),
    ]
    text = table(rows)
    assert "| four-legged | 2 | 0.700 (2) | 0.650 (2) |" in text
    assert "as good on 1 of 2 shapes: wolf." in text


def test_odds_find_the_term_that_tells():
    generator = np.random.default_rng(0)
    rows = generator.normal(size=(40, 6, len(TERMS)))
    rows[:, TRUE, 3] += 4
    odds = fit_odds(list(rows))
    assert odds.argmax() == 3
    assert np.mean((rows @ odds).argmax(axis=1) == TRUE) > 0.9


def test_the_least_priors_keep_whatever_stands():
    doubtful = np.array([1.0, 0, 0, 0, 0, 0])
    up, down = least_priors({"one": doubtful})
    assert decided(doubtful, TRUE, (up, down)) == (TRUE // 2, TRUE)
    assert decided(doubtful, TRUE, (up - 0.2, down - 0.2))[0] != TRUE // 2


def test_own_shapes_keep_their_axis_whatever_all_do():
    """One of many may fall; not where it is one of few that count by themselves."""
    odds = {f"also/{number}": np.array([0, 0, 5.0, 0, 0, 0]) for number in range(200)}
    odds["own"] = np.array([2.0, 0, 0, 0, 0, 0])
    assert least_priors(odds)[0] == 0
    up, _ = least_priors(odds, {"own"})
    assert decided(odds["own"], TRUE, (up, up))[0] == TRUE // 2


def test_the_file_up_grows_where_its_down_must_lose():
    """Here −y is likelier than +y, and the axis needs both unless +y gets more."""
    odds = {"one": np.array([2.0, 2, 0, 2.5, 0, 0])}
    up, down = least_priors(odds)
    assert decided(odds["one"], TRUE, (up, down)) == (TRUE // 2, TRUE)
    assert down < up


def lessons(count):
    """Shapes whose first token says which way is up, as does their middle; the rest is chance."""
    generator = np.random.default_rng(0)
    made = []
    for number in range(count):
        seen = generator.normal(size=(len(FRAMES), len(LAYERS), 5))
        seen[TRUE, :, 0] += 3
        evidence = generator.normal(size=(len(FRAMES), len(EVIDENCE)))
        evidence[TRUE, EVIDENCE.index("middle")] += 3
        name = f"also/family{number % 3}/{number}" if number % 2 else f"upright/wolf{number}"
        made.append(Lesson(name, seen - seen.mean(axis=0), evidence))
    return made


def test_families_are_folders_of_further_shapes():
    assert [each.family for each in lessons(4)] == ["four-legged", "family1", "four-legged", "family0"]


@pytest.mark.parametrize("group", [by_shape, by_family])
def test_looks_without_a_group_are_what_the_others_teach(group):
    """The short cut gives what a regression on the others alone gives."""
    some = lessons(8)
    rows, _ = scaled(some)
    found = left_out_looks(tuple(some), group)
    targets, inverse = ridge(rows)
    kernel = np.linalg.inv(inverse)
    assert found.shape == (8, len(FRAMES), len(LOOKS))
    for number, lesson in enumerate(some):
        others = np.repeat([group(each) != group(lesson) for each in some], len(FRAMES))
        dual = np.linalg.solve(kernel[np.ix_(others, others)], targets[others])
        own = slice(number * len(FRAMES), (number + 1) * len(FRAMES))
        assert np.allclose(found[number], kernel[own, others] @ dual, atol=1e-8)


def test_what_is_learned_finds_shapes_that_it_never_saw():
    some = lessons(24)
    assert len(both_terms(some)) == 48
    odds = left_out_odds(tuple(some), by_shape)
    assert np.mean([each.argmax() == TRUE for each in odds.values()]) > 0.8


def test_further_shapes_come_from_folders_of_families(tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "also" / "people").mkdir(parents=True)
    robot(4000).mesh.save(tmp_path / "also" / "people" / "one.glb")
    names = [name for name, _ in upright_shapes(tmp_path / "own", tmp_path / "also")]
    assert names == ["chair", "quadruped", "robot", "also/people/one"]
