"""Test the tables for labelled shapes, the average precision by values computed by hand, and the reader of rigs."""

import csv
from unittest import mock

import numpy as np
import pytest
from made_field import field_of
from mesh_files import CORNERS, CUBE, Gltf, write

import dfd
from bench.quality import labelled
from bench.quality.__main__ import main
from bench.quality.constants import changed, constants
from bench.quality.labelled import LEGEND
from bench.quality.measures import average_precision, session_of
from bench.quality.shapes import characters
from dfd.segmentation import patches, seeds


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with two chairs whose faces are labelled."""
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
    return root


def test_the_bench_writes_its_tables(folder, tmp_path):
    with mock.patch.object(dfd, "distill", lambda mesh, encoder, **_: field_of(mesh)):
        main(["labelled", str(folder), "--output", str(tmp_path)])
    names, *rows = csv.reader((tmp_path / "labelled.csv").read_text().splitlines())
    assert [row[:2] for row in rows] == [["Chair", "Chair 9"], ["Chair", "Chair 10"]]
    values = dict(zip(names, rows[0], strict=True))
    assert set(LEGEND) < set(values)
    assert all(0 <= float(value) <= 1 for value in rows[0][2:])
    text = (tmp_path / "labelled.md").read_text()
    assert "| mean |" in text


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_fields_and_sessions_have_the_preset(preset, folder, tmp_path):
    made = []

    def distill(mesh, encoder, **how):
        made.append(how["preset"])
        return field_of(mesh)

    with (
        mock.patch.object(dfd, "distill", distill),
        mock.patch.object(labelled, "judged", return_value={"precision": 1.0}),
    ):
        main(["labelled", str(folder), "--output", str(tmp_path), "--preset", preset])
    assert set(made) == {preset}
    assert (tmp_path / f"labelled{'_paper' if preset == 'paper' else ''}.csv").is_file()
    shape = next(labelled.labelled_shapes(folder))
    field = field_of(shape.mesh).with_settings({"preset": preset})
    assert session_of(shape.mesh, field).preset == preset
    assert session_of(shape.mesh, field_of(shape.mesh)).preset == "default"
    found = labelled.judged(shape, field)
    assert (found["grip"] == found["paper's grip"]) == (preset == "paper")


@pytest.mark.parametrize(
    ("scores", "relevant", "expected"),
    [
        ((0.9, 0.7, 0.4, 0.1), (1, 1, 0, 0), 1.0),
        ((0.9, 0.7, 0.4, 0.1), (0, 0, 1, 1), (1 / 3 + 2 / 4) / 2),
        ((0.9, 0.7, 0.4, 0.1), (0, 1, 0, 0), 1 / 2),
        # One of three hits has the highest score, and the other two share their score with one miss.
        ((1.0, 0, 0, 0), (1, 1, 1, 0), 1 / 3 + 2 / 3 * 3 / 4),
        ((1.0, 0, 0, 0), (1, 0, 1, 1), 1 / 3 + 2 / 3 * 3 / 4),
        ((0.0,) * 8, (1, 1, 1, 0, 0, 0, 0, 0), 3 / 8),
    ],
)
def test_average_precision_is_the_mean_of_the_precision_at_every_hit(scores, relevant, expected):
    assert average_precision(np.array(scores), np.array(relevant, bool)) == pytest.approx(expected)


def test_a_skinned_file_is_read_with_and_without_accessories(tmp_path, capsys):
    gltf = Gltf()
    joints = gltf.accessor(np.repeat([(0, 0, 0, 0), (1, 0, 0, 0)], 4, axis=0), 5121, "VEC4")
    weights = gltf.accessor([(1, 0, 0, 0)] * 8, 5126, "VEC4")
    skinned = {"JOINTS_0": joints, "WEIGHTS_0": weights}
    gltf.node(mesh=gltf.mesh("body", CORNERS, CUBE, attributes=skinned), skin=0)
    gltf.node(mesh=gltf.mesh("sword", CORNERS + 5, CUBE))
    gltf.header["skins"] = [{"joints": [gltf.node(name="upperarm.l"), gltf.node(name="head")]}]
    write(tmp_path / "figure.glb", gltf.glb())
    whole, bare = characters(tmp_path)
    assert capsys.readouterr().out == ""
    assert [each.name for each in (whole, bare)] == ["figure, merged names", "figure without accessories, merged names"]
    assert whole.parts == ("arm", "head")
    assert np.bincount(whole.labels + 1).tolist() == [8, 4, 4]
    np.testing.assert_array_equal(bare.labels, bare.mesh.vertices[:, 0])


def test_a_constant_changes_in_all_modules_that_use_it_and_comes_back():
    known = {(module.__name__.rpartition(".")[2], name): value for module, name, value in constants("segmentation")}
    assert known["seeds", "NEAR"] == seeds.NEAR == patches.NEAR
    assert ("trees", "TINY") not in known, "a module does not define what it imports"
    with changed("segmentation", "NEAR", seeds.NEAR, 2.0):
        assert (seeds.NEAR, patches.NEAR) == (2.0, 2.0)
    assert known["seeds", "NEAR"] == seeds.NEAR == patches.NEAR
