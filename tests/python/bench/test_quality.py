"""Labelled shapes: measures computed by hand, how folders and rigs are read, and that the tables are written."""

from __future__ import annotations

import csv
from unittest import mock

import numpy as np
import pytest
from made_field import field_of
from skinned_figure import skinned_figure

import dfd
from bench.quality.labelled import main
from bench.quality.measures import average_precision
from bench.quality.shapes import characters


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two chairs, labelled face by face; a landmark on each leg's foot, the first two mirroring each other."""
    root = tmp_path_factory.mktemp("labelled")
    (root / "Chair").mkdir()
    sample = dfd.samples.chair(4_000)
    of_face = sample.labels[sample.mesh.faces[:, 0]]
    for name in ("9", "10"):
        sample.mesh.save(root / "Chair" / f"{name}.off")
        lines = (
            f"{part}\n{' '.join(str(face + 1) for face in np.flatnonzero(of_face == number))}\n"
            for number, part in enumerate(sample.parts)
        )
        (root / "Chair" / f"{name}_labels.txt").write_text("".join(lines))
        feet = [int(sample.vertices_of("leg", leg)[0]) for leg in range(2)]
        (root / "Chair" / f"{name}.vts").write_text("".join(f"{foot} 0 0 0\n" for foot in feet))
    (root / "Chair" / "counterparts.info").write_text("0 1\n\n2\n")
    return root


@pytest.mark.parametrize(
    ("words", "page", "own"),
    [
        (["labelled", "--paper"], "labelled", "precision,thickness precision,paper precision,part,grip,counterparts"),
        pytest.param(["grip"], "grip", "paper: grip,default: coverage,default: leak", marks=pytest.mark.slow),
        (["labelled", "--turned", "--only", "Chair"], "turned", "precision,at random,by axes"),
    ],
)
def test_the_bench_writes_its_tables(folder, tmp_path, words, page, own):
    with mock.patch.object(dfd, "distill", lambda mesh, **_: field_of(mesh)):
        main([words[0], str(folder), *words[1:], "--output", str(tmp_path)])
    names, *rows = csv.reader((tmp_path / f"{page}.csv").read_text().splitlines())
    assert [row[:3] for row in rows] == [["Chair", "Chair 9", "chosen on"], ["Chair", "Chair 10", "judged"]]
    values = dict(zip(names, rows[0], strict=True))
    assert all(0 <= float(values[name]) <= 1 for name in own.split(","))
    assert "## Judged on these" in (tmp_path / f"{page}.md").read_text()
    assert (tmp_path / "labelled_worst.png").exists() == (page == "labelled")


@pytest.mark.parametrize(
    ("scores", "relevant", "expected"),
    [
        ((0.9, 0.7, 0.4, 0.1), (1, 1, 0, 0), 1.0),
        ((0.9, 0.7, 0.4, 0.1), (0, 0, 1, 1), (1 / 3 + 2 / 4) / 2),
        ((0.9, 0.7, 0.4, 0.1), (0, 1, 0, 0), 1 / 2),
        # One of three hits on top, the two others somewhere among three ties: 1/3 · 1 + 2/3 · 3/4.
        ((1.0, 0, 0, 0), (1, 1, 1, 0), 1 / 3 + 2 / 3 * 3 / 4),
        ((1.0, 0, 0, 0), (1, 0, 1, 1), 1 / 3 + 2 / 3 * 3 / 4),
        ((0.0,) * 8, (1, 1, 1, 0, 0, 0, 0, 0), 3 / 8),
    ],
)
def test_average_precision_is_the_mean_of_the_precision_at_every_hit(scores, relevant, expected):
    assert average_precision(np.array(scores), np.array(relevant, bool)) == pytest.approx(expected)


def test_a_skinned_file_is_read_whole_and_without_what_only_hangs_on_a_bone(tmp_path):
    (tmp_path / "figure.glb").write_bytes(skinned_figure())
    told = []
    found = list(characters(tmp_path, told.append))
    assert told == []
    assert [shape.name for shape in found] == ["figure, merged names", "figure without accessories, merged names"]
    whole, bare = found
    assert whole.parts == ("arm", "head")
    # the skin is moved by its node to x = 5; the fourth weight of its second vertex sits in another set of joints
    by_place = {tuple(place): label for place, label in zip(whole.mesh.vertices.tolist(), whole.labels, strict=True)}
    assert by_place == {
        (5.0, 0.0, 0.0): 0,
        (6.0, 0.0, 0.0): 1,
        (5.0, 1.0, 0.0): 0,
        (0.0, 0.0, 3.0): -1,
        (1.0, 0.0, 3.0): -1,
        (0.0, 1.0, 3.0): -1,
    }
    assert sorted(map(tuple, bare.mesh.vertices.tolist())) == [(5, 0, 0), (5, 1, 0), (6, 0, 0)]
    assert (bare.labels >= 0).all()
