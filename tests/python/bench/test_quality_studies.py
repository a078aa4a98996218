"""The quality bench's studies: what is distilled for them, and what they say in words."""

from __future__ import annotations

import numpy as np
import pytest

from bench.quality import studies
from bench.quality.evaluate import Draw
from bench.quality.fields import Lab
from bench.quality.report import as_markdown, compared, in_words
from bench.quality.shapes import Shape
from bench.quality.studies import BARYCENTRIC, GRAY, PLAIN, TEXTURED, VERTEX, Bench, Row, compare
from dfd import Mesh, samples
from dfd.mesh.appearance import Appearance, Material


class Field:
    """Features that are the points themselves, pushed aside by `shift`."""

    def __init__(self, shift):
        self.shift = shift

    def __call__(self, points):
        far = np.column_stack([points + [self.shift, 0, 0], np.full(len(points), 5.0)])
        return (far / np.linalg.norm(far, axis=1, keepdims=True)).astype(np.float32)


class Fields:
    """Stands for a lab: gives such fields, and has no weights for the encoders named as missing."""

    def __init__(self, missing=()):
        self.settings = {"encoder": "own"}
        self.missing = missing
        self.asked = []

    def field(self, name, mesh, **settings):
        self.asked.append((name, settings))
        if settings.get("encoder") in self.missing:
            raise FileNotFoundError("no weights. Three ways")
        return Field(settings.get("shift", 0.0))


@pytest.fixture
def chair():
    sample = samples.chair(4000)
    return Shape("chair", sample.mesh, sample.labels, sample.parts)


def bench_of(lab, told=None, seeds=(0,)):
    return Bench(lab, Draw(1, (0,)), seeds, (told if told is not None else []).append)


def test_encoders_without_weights_share_one_row(chair):
    told = []
    names = {"own": {}, "large": {"encoder": "large"}, "small": {"encoder": "small"}, "huge": {"encoder": "huge"}}
    lab = Fields(missing=("large", "huge"))
    shapes = [chair, Shape("seat", chair.mesh)]
    rows = compare(bench_of(lab, told), "encoders", shapes, names)
    assert [(row.shape, row.setting, row.note) for row in rows] == [
        ("chair", "own", ""),
        ("chair", "small", ""),
        ("seat", "own", ""),
        ("seat", "small", ""),
        ("none", "large, huge", "no weights at hand"),
    ]
    assert told == ["no weights", "no weights"]
    assert [name for name, settings in lab.asked if settings.get("encoder") == "large"] == ["chair"]  # and never again


def test_every_preset_has_its_turn():
    found = studies.encoders(Fields())
    assert next(iter(found)) == "own"
    assert found["own"] == {"encoder": "own"}
    assert set(found) == {"own", *studies.KNOWN_ENCODERS}
    assert found["sam-base"] == {"encoder": "sam-base", "resolution": 1024}


def test_the_first_setting_is_off_by_nothing_and_others_by_how_they_differ(chair):
    rows = compare(bench_of(Fields()), "shifts", [chair], {"none": {}, "some": {"shift": 1.0}, "more": {"shift": 2.0}})
    off = [row.verdict["off the first"] for row in rows]
    assert off[0] == 0
    assert 0 < off[1] < off[2]


def test_features_that_tell_sides_apart_have_a_symmetry_error(chair):
    middle = -chair.mesh.bounds.mean(axis=0)[0]
    even, odd = (
        bench_of(Fields()).verdict(chair, {"shift": shift})["symmetry error"] for shift in (middle, middle + 1.0)
    )
    assert even == pytest.approx(0, abs=1e-5)
    assert odd > 5e-4
    lying = Shape("lying", Mesh(chair.mesh.vertices[:, [1, 0, 2]], chair.mesh.faces))
    assert "symmetry error" not in bench_of(Fields()).verdict(lying, {})


def test_the_spread_is_that_among_seeds(chair):
    verdict = bench_of(Fields(), seeds=(0, 1)).verdict(chair, {})
    assert verdict["precision ±"] == 0
    assert "precision ±" not in bench_of(Fields(), seeds=(0, 1)).verdict(chair, {"seed": 3})


def test_in_gray_a_mesh_has_no_colors(monkeypatch):
    corners = np.arange(3, dtype=np.int32)
    looks = Appearance(corners, corners[None], np.zeros(1, np.int32), (Material((1.0, 0.0, 0.0, 1.0)),))
    mesh = Mesh(np.eye(3), corners[None], appearance=looks)
    lab = Lab({}, [].append)
    seen = []
    monkeypatch.setattr(lab, "_encoder", lambda name, block, **how: name)
    monkeypatch.setattr("dfd.distill", lambda mesh, encoder, **settings: seen.append((mesh, settings)) or len(seen))
    first = lab.field("one", mesh)
    assert lab.field("one", mesh, texture=False) != first
    assert lab.field("one", mesh) == first
    (colored, settings), (gray, others) = seen
    assert colored is mesh
    assert gray.appearance is None
    assert np.array_equal(gray.vertices, mesh.vertices)
    assert np.array_equal(gray.faces, mesh.faces)
    assert settings == others
    assert "texture" not in settings


def test_supervision_is_told_in_words():
    rows = [
        Row("supervision", "spot", BARYCENTRIC, {"Dirichlet energy": 2.0, "symmetry error": 0.05}),
        Row("supervision", "spot", PLAIN, {"Dirichlet energy": 4.0, "symmetry error": 0.2}),
        Row("supervision", "spot", VERTEX, {"Dirichlet energy": 5.0, "symmetry error": 0.3}),
        Row("supervision", "knight", BARYCENTRIC, {"Dirichlet energy": 3.0, "precision": 0.8}),
        Row("supervision", "knight", VERTEX, {"Dirichlet energy": 2.0, "precision": 0.75}),
    ]
    assert in_words(rows) == [
        "spot, barycentric against plain vertex: 2.50 times smoother (Dirichlet energy 2 against 5).",
        "spot, plain barycentric against plain vertex: 1.25 times smoother (Dirichlet energy 4 against 5).",
        "spot, barycentric against plain barycentric: 4.00 times more symmetric (symmetry error 0.05 against 0.2).",
        "knight, barycentric against plain vertex: 1.50 times rougher (Dirichlet energy 3 against 2), "
        "0.050 more precise (precision 0.800 against 0.750).",
    ]
    page = as_markdown(rows, "Settings.")
    assert "\n\n- spot, barycentric against plain vertex: 2.50 times smoother" in page
    assert page.index("| knight |") < page.index("- spot,")


def test_textures_are_told_in_words_and_other_studies_not():
    verdicts = {TEXTURED: {"precision": 0.8}, GRAY: {"precision": 0.7}}
    rows = [Row("textures", "knight", setting, verdict) for setting, verdict in verdicts.items()]
    assert in_words(rows) == ["knight, gray against textured: 0.100 less precise (precision 0.700 against 0.800)."]
    assert in_words([Row("views", "knight", setting, verdict) for setting, verdict in verdicts.items()]) == []


def test_nothing_is_infinitely_many_times_less():
    assert compared("symmetry error", 0.0, 0.5).startswith("infinitely many times more symmetric")
    assert compared("symmetry error", 0.5, 0.5).startswith("1.00 times")
