"""Rigs by rule, families, and how what was learned about up is judged."""

from __future__ import annotations

import numpy as np
import pytest

from bench.quality.families import family_of
from bench.quality.learn_up import TRUE, decided, fit_odds, least_priors
from bench.quality.parts import kind_of_part, without_few
from bench.quality.shapes import Shape, rigs
from bench.quality.studies import Row
from bench.quality.upright import EUCLIDEAN, STUDY, TURNS, by_family, turned
from dfd.distillation.up_probe import TERMS
from dfd.samples import quadruped


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
    text = by_family(rows)
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
