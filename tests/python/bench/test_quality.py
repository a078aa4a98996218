"""Labelled shapes: measures computed by hand, how folders and rigs are read, and that the tables are written."""

from __future__ import annotations

import csv
from unittest import mock

import numpy as np
import pytest
from made_field import field_of
from skinned_figure import skinned_figure

import dfd
from bench.quality import labelled
from bench.quality.labelled import main
from bench.quality.labelled_shapes import labelled_shapes
from bench.quality.measures import average_precision, draw_handles, euclidean, geodesic, moving, part_precision
from bench.quality.parts import family_of, kind_of_part, merged
from bench.quality.shapes import characters, rigs
from dfd import Mesh

SQUARE = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
HALVES = np.array([(0, 1, 2), (0, 2, 3)])


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


def test_a_folder_is_read_by_category_and_half_of_it_judges(folder):
    found = list(labelled_shapes(folder))
    assert [(each.category, each.shape.name, each.judged) for each in found] == [
        ("Chair", "Chair 9", False),
        ("Chair", "Chair 10", True),
    ]
    sample, first = dfd.samples.chair(4_000), found[0]
    assert first.shape.parts == sample.parts
    assert (first.labels == sample.labels).mean() > 0.9
    assert first.counterparts == ((0, 1),)
    assert len(np.unique(first.components[first.labels == sample.parts.index("leg")])) == 4
    assert [each.shape.name for each in labelled_shapes(folder, quick=True)] == ["Chair 10"]
    assert [each.shape.name for each in labelled_shapes(None, quick=True)] == ["chair", "quadruped", "robot"]


def test_labels_that_do_not_fit_are_refused(folder, tmp_path):
    with pytest.raises(ValueError, match="labelled: there is no CATEGORY/N_labels.txt"):
        next(labelled_shapes(tmp_path))
    with pytest.raises(ValueError, match="labelled: there is no CATEGORY/N_labels.txt"):
        next(labelled_shapes(folder, only=["Table"]))
    (tmp_path / "Chair").mkdir()
    for name in ("9.off", "9_labels.txt"):
        (tmp_path / "Chair" / name).write_text((folder / "Chair" / name).read_text())
    labels = tmp_path / "Chair" / "9_labels.txt"
    whole = labels.read_text()
    labels.write_text(whole.replace(" 2 ", " ", 1))
    with pytest.raises(ValueError, match="leaves faces without a name"):
        next(labelled_shapes(tmp_path))
    labels.write_text(whole.replace(" 2 ", " 99999 ", 1))
    with pytest.raises(ValueError, match="names a face that the mesh does not have"):
        next(labelled_shapes(tmp_path))


def test_overlaps_are_those_of_area():
    on = mock.Mock(areas=np.array([1.0, 2.0, 1.0]))
    truth = np.array([True, True, False])
    assert labelled.soft_iou(on, truth, truth) == 1
    assert labelled.soft_iou(on, np.array([0.5, 0.5, 0.5]), truth) == pytest.approx(1.5 / 3.5)
    assert labelled.threshold_iou(on, np.array([0.9, 0.5, 0.1]), truth) == 1
    assert labelled.threshold_iou(on, np.array([0.9, 0.1, 0.5]), truth) == pytest.approx(3 / 4)
    assert labelled.threshold_iou(on, np.ones(3), truth) == pytest.approx(3 / 4)


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


def test_a_verdict_is_a_mean_per_part_and_skips_what_has_none():
    labels = np.array([0, 0, 0, 1, 1, 2])
    first, second = np.array([1.0, 0.9, 0.8, 0.1, 0.1, 0.1]), np.array([0.9, 0.2, 1.0, 0.9, 0.9, 0.9])
    weights = np.stack([first, second, np.array([0.1, 0.1, 0.1, 1.0, 0.9, 0.1]), np.ones(6)], axis=1)
    # Handle 2 has one of its kind among the first four and one last; part 2 is nothing but its handle.
    expected = {0: pytest.approx((1 + (1 / 4 + 2 / 5) / 2) / 2), 1: pytest.approx(1)}
    assert part_precision(weights, labels, np.array([0, 2, 3, 5])) == expected
    assert moving(first[:5, None] > 0.1, np.array([0, 0, 1, 1, -1])) == pytest.approx(3 / 4)


def test_handles_are_drawn_in_every_part_and_again_for_the_same_seed():
    labels = np.repeat([0, 1, 2, -1], [10, 2, 5, 7])
    handles = draw_handles(labels, 4, seed=3)
    assert np.bincount(labels[handles]).tolist() == [4, 2, 4]
    assert len(set(handles.tolist())) == len(handles)
    assert (handles == draw_handles(labels, 4, seed=3)).all()
    assert (handles != draw_handles(labels, 4, seed=4)).any()


def test_distances_as_weights_are_one_at_the_handle_and_zero_at_the_farthest():
    handles = np.array([0, 1])
    through_space = euclidean(SQUARE, handles)
    assert through_space[:, 0] == pytest.approx([1, 1 - np.sqrt(0.5), 0, 1 - np.sqrt(0.5)])
    along = geodesic(dfd.Geodesics(Mesh(SQUARE, HALVES)), handles)
    assert along.shape == (4, 2)
    assert [along[0, 0], along[1, 1]] == [1, 1]
    assert along.min(axis=0) == pytest.approx([0, 0], abs=1e-6)


@pytest.mark.parametrize(
    ("find", "found"),
    [
        (merged, "Head=head handslot.l=hand lowerarm.r=arm LeftForeArm=arm upperleg.l=leg hips=torso antenna=None"),
        (kind_of_part, "Ear1.L=ear wing_feather_1_1_L=wing IKFrontLeg.L=foot Front_Leg_Tip_L=foot lowerarm_l=arm"),
        (kind_of_part, "FrontShoulder.L=torso BackLowerLeg.R=leg mouth_tip=head back_fin_0_l=fin handle=hand"),
        (kind_of_part, "Abdomen=torso Main6=tail cape=None"),
        (family_of, "chair_nonmanifold=seats man=people wolf=four-legged rock=rock"),
    ],
)
def test_names_say_what_a_part_and_a_shape_are(find, found):
    for name, kind in (each.split("=") for each in found.split()):
        assert str(find(name)) == kind


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


def test_what_cannot_be_read_is_told_and_left_out(tmp_path):
    (tmp_path / "figure.glb").write_bytes(skinned_figure(weights=b""))
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "bad.glb").write_bytes(b"none")
    told = []
    assert [*characters(tmp_path, told.append), *rigs(tmp_path, told.append)] == []
    assert [line.partition(":")[0] for line in told] == ["figure.glb", "bad.glb"]
