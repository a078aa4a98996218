"""The bench on labelled meshes: its measures, how it reads a folder, and that it writes its page."""

from unittest import mock

import numpy as np
import pytest
from made_field import field_of

import dfd
from bench.quality import labelled
from bench.quality.__main__ import main
from bench.quality.labelled_shapes import labelled_shapes


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
