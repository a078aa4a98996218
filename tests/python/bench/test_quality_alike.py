"""Test the comparison of who follows with the sets that people mean, by right and by wrong parts."""

from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from made_field import field_of

import dfd
from bench.quality import alike
from bench.quality.__main__ import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a chair, its labels, and the segments of two people, who cut off each leg alike."""
    root = tmp_path_factory.mktemp("alike")
    (root / "Chair").mkdir()
    sample = dfd.samples.chair(4_000)
    of_face, instance = (each[sample.mesh.faces[:, 0]] for each in (sample.labels, sample.instances))
    sample.mesh.save(root / "Chair" / "1.off")
    lines = (
        f"{part}{number}\n{' '.join(map(str, 1 + np.flatnonzero(of_face == number)))}\n"
        for number, part in enumerate(sample.parts)
    )
    (root / "Chair" / "1_labels.txt").write_text("".join(lines))
    segments = np.unique(np.stack([of_face, instance], axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    np.savez(root / "Chair" / "1_people.npz", segment=np.stack([segments, segments]))
    return root


class Made:
    """Parts of a chair: `whole` and `alone` return the vertices of a segment's set and of a segment."""

    def __init__(self, whole, alone):
        self.of = {"all": whole, "none": alone}

    def part(self, vertex, level=0, *, follow="all"):
        return SimpleNamespace(mask=self.of[follow](vertex))


def judged(folder, whole, alone):
    """Return the numbers for made parts."""
    (shape,) = alike.alike_shapes(folder)
    with mock.patch.object(alike, "Parts", return_value=Made(whole(shape), alone(shape))):
        return alike.judged(shape, field_of(shape.mesh))


def of_labels(shape):
    """Return the function that maps a vertex to all vertices of the segments with its label."""
    labels = np.full(len(shape.mesh.vertices), -1)
    labels[shape.mesh.faces] = shape.of_face[:, None]
    return lambda vertex: labels == labels[vertex]


def of_segments(shape):
    """Return the function that maps a vertex to all vertices of its segment."""
    labels = np.full(len(shape.mesh.vertices), -1)
    labels[shape.mesh.faces] = shape.segments[0][:, None]
    return lambda vertex: labels == labels[vertex]


def everything(shape):
    return lambda _: np.ones(len(shape.mesh.vertices), bool)


def test_parts_with_all_others_of_their_label_are_right(folder):
    found = judged(folder, of_labels, of_segments)
    assert found["set"] > 0.9
    assert found["follows"] > 0.9
    assert found["right"] > 0.9
    assert found["component"] > 0.9
    assert found["person's set"] == pytest.approx(1)


def test_parts_without_others_miss_them(folder):
    found = judged(folder, of_segments, of_segments)
    assert found["follows"] < 0.05
    assert found["others: set"] < 0.6
    assert np.isnan(found["right"]), "nothing follows"
    assert found["alone"] == 1


def test_the_whole_shape_holds_too_much(folder):
    found = judged(folder, everything, of_segments)
    assert found["follows"] == pytest.approx(1)
    assert found["right"] < 0.6
    assert found["alone"] < 0.6


def test_the_bench_writes_a_table_of_who_follows(folder, tmp_path):
    with mock.patch.object(dfd, "distill", lambda mesh, encoder, **_: field_of(mesh)):
        main(["alike", str(folder), "--output", str(tmp_path)])
    text = (tmp_path / "alike.md").read_text()
    assert "person's set" in text
    assert "random: set" in text
