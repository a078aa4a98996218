"""Labelled shapes: measures computed by hand, how folders and rigs are read, and that the tables are written."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from made_field import field_of
from skinned_figure import skinned_figure

import dfd
from bench.quality import labelled
from bench.quality.__main__ import main
from bench.quality.labelled_shapes import labelled_shapes
from bench.quality.measures import (
    average_precision,
    draw_handles,
    euclidean,
    geodesic,
    handle_precision,
    moving,
    part_precision,
)
from bench.quality.parts import family_of, kind_of_part, label_vertices, merged, only, without_few
from bench.quality.shapes import characters, rigs
from dfd import Mesh
from dfd.mesh.appearance import Appearance, Material

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
    assert len(np.unique(first.instances[first.labels == sample.parts.index("leg")])) == 4
    assert [each.shape.name for each in labelled_shapes(folder, quick=True)] == ["Chair 10"]
    assert [each.shape.name for each in labelled_shapes(None, quick=True)] == ["chair", "quadruped", "robot"]


def test_labels_that_do_not_fit_are_refused(folder, tmp_path):
    with pytest.raises(ValueError, match="labelled: there is no CATEGORY/N_labels.txt"):
        next(labelled_shapes(tmp_path))
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


@pytest.mark.parametrize("verb", ["labelled", pytest.param("grip", marks=pytest.mark.slow)])
def test_the_bench_writes_its_tables(folder, tmp_path, verb):
    with mock.patch.object(dfd, "distill", lambda mesh, **_: field_of(mesh)):
        main([verb, str(folder), "--paper", "--output", str(tmp_path)])
    table = (tmp_path / f"{verb}.csv").read_text().splitlines()
    assert [line.split(",")[:3] for line in table[1:]] == [
        ["Chair", "Chair 9", "chosen on"],
        ["Chair", "Chair 10", "judged"],
    ]
    names = table[0].split(",")
    values = dict(zip(names, table[1].split(","), strict=True))
    own = ("paper: grip",)
    if verb == "labelled":
        own = ("precision", "thickness precision", "paper precision", "part", "instance", "grip", "counterparts")
    for name in own:
        assert 0 <= float(values[name]) <= 1
    assert "## Judged on these" in (tmp_path / f"{verb}.md").read_text()
    assert (tmp_path / "labelled_worst.png").exists() == (verb == "labelled")


def test_turned_shapes_are_compared_with_those_that_stand(folder, tmp_path):
    with mock.patch.object(dfd, "distill", lambda mesh, **_: field_of(mesh)):
        main(["labelled", str(folder), "--turned", "--quick", "--only", "Chair", "--output", str(tmp_path)])
    head, row = ((tmp_path / "turned.csv").read_text().splitlines())[:2]
    values = dict(zip(head.split(","), row.split(","), strict=True))
    for name in ("at random", "by axes"):
        loss = float(values["precision"]) - float(values[name])
        assert float(values[f"{name}: loss"]) == pytest.approx(loss, abs=1e-5)
        assert 0 <= float(values[f"{name}: off"]) <= 90
    with pytest.raises(ValueError, match="there is no CATEGORY"):
        next(labelled_shapes(folder, only=["Table"]))


def test_turns_are_the_same_each_time_and_leave_up_where_it_was_in_none():
    turns = labelled.turns("Chair 10")
    assert all(np.array_equal(turns[name], again) for name, again in labelled.turns("Chair 10").items())
    for turn in turns.values():
        assert np.allclose(turn @ turn.T, np.eye(3))
        assert np.linalg.det(turn) == pytest.approx(1)
        assert turn[1, 1] < 0.999
    assert set(np.abs(turns["by axes"]).ravel()) == {0, 1}


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


def test_precision_leaves_out_the_handle_and_vertices_without_a_part():
    labels = np.array([0, 0, 1, 1, -1, -1])
    column = np.array([1.0, 0.5, 0.6, 0.1, 0.9, 0.8])
    # besides itself, handle 0 has one vertex of its kind, ranked second of three that count
    assert handle_precision(column[:, None], labels, np.array([0])) == pytest.approx([1 / 2])
    column[4:] = 0
    assert handle_precision(column[:, None], labels, np.array([0])) == pytest.approx([1 / 2])


def test_part_precision_is_a_mean_per_part_and_skips_parts_of_one_vertex():
    labels = np.array([0, 0, 0, 1, 1, 2])
    first = np.array([1.0, 0.9, 0.8, 0.1, 0.1, 0.1])
    second = np.array([0.9, 0.2, 1.0, 0.9, 0.9, 0.9])  # handle 2: one of its kind among the first four, one last
    third = np.array([0.1, 0.1, 0.1, 1.0, 0.9, 0.1])
    weights = np.stack([first, second, third, np.ones(6)], axis=1)
    found = part_precision(weights, labels, np.array([0, 2, 3, 5]))
    assert found == {0: pytest.approx((1 + (1 / 4 + 2 / 5) / 2) / 2), 1: pytest.approx(1)}


def test_only_vertices_with_a_part_count_as_moving():
    weights = np.array([[1.0], [0.5], [0.25], [0.0], [1.0]])
    assert moving(weights, np.array([0, 0, 1, 1, -1])) == pytest.approx(3 / 4)


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
    ("joint", "part"),
    [
        ("Head", "head"),
        ("handslot.l", "hand"),
        ("lowerarm.r", "arm"),
        ("LeftForeArm", "arm"),
        ("control-toe-roll.l", "foot"),
        ("upperleg.l", "leg"),
        ("hips", "torso"),
        ("antenna", None),
    ],
)
def test_joints_fall_into_the_parts_of_a_character(joint, part):
    assert merged(joint) == part


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


@pytest.mark.parametrize(
    ("name", "family"), [("chair_nonmanifold", "seats"), ("man", "people"), ("wolf", "four-legged"), ("rock", "rock")]
)
def test_families(name, family):
    assert family_of(name) == family


def test_vertices_are_of_the_kind_of_their_joint_and_small_parts_are_left_out():
    labels, parts = label_vertices(["hand.l", None, "foot.l", "antenna"], merged)
    assert parts == ("foot", "hand")
    assert labels.tolist() == [1, -1, 0, -1]
    labels, parts = without_few(np.array([0, 0, 1, 2, 2, -1]), ("ear", "tail", "leg"), 2)
    assert labels.tolist() == [0, 0, -1, 1, 1, -1]
    assert parts == ("ear", "leg")


def test_a_part_of_a_mesh_keeps_its_looks():
    corners = np.arange(6, dtype=np.int32) % 4
    looks = Appearance(
        corners=corners,
        corner_faces=np.array([(0, 1, 2), (3, 4, 5)], np.int32),
        face_material=np.array([0, 1], np.int32),
        materials=(Material(), Material((1.0, 0.0, 0.0, 1.0))),
    )
    vertices = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)])
    mesh = Mesh(vertices, np.array([(0, 1, 2), (3, 0, 1)]), appearance=looks)
    part, old = only(mesh, np.array([True, True, False, True]))
    assert old.tolist() == [0, 1, 3]
    assert part.vertices.tolist() == vertices[[0, 1, 3]].tolist()
    assert part.faces.tolist() == [[2, 0, 1]]
    assert part.appearance is not None
    assert part.appearance.corners.tolist() == [-1, -1, -1, 2, 0, 1]
    red = part.appearance.albedo(np.array([0]), np.array([(1, 0, 0)]))
    assert red.tolist() == [[1, 0, 0, 1]]


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
