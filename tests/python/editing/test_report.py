"""Test the report of an edit."""

import re

import numpy as np
import pytest

import dfd
from dfd.editing.report import largest_stretch, percent
from dfd.editing.weights.axis_motions import bendable_parts, level_with_axis


def test_it_says_how_much_moved_how_far_and_whether_the_handle_arrived(paper, mesh):
    paper.add(5, translation=(0, 0.48, 0), name="ear")
    report = paper.report()
    distances = np.linalg.norm(paper.vertices - mesh.vertices, axis=1)
    assert report.farthest == distances.max() == pytest.approx(0.48)
    assert report.moved == np.mean(distances > 1e-3 * mesh.diagonal)
    (handle,) = report.handles
    assert handle.arrived
    assert handle.missing == pytest.approx(0, abs=1e-7)
    np.testing.assert_allclose(handle.landed, mesh.vertices[5] + (0, 0.48, 0))
    told = f"moved {100 * report.moved:.0f} % of the vertices, up to 0.48, and stretched edges up to "
    assert str(report) == f"{told}{report.stretch:.1f} times; handle 1 (ear) arrived"
    assert report.warning is None


def test_it_says_how_far_a_handle_is_from_where_it_was_sent(paper):
    paper.add(5, translation=(0, 0.4, 0))
    paper.fix(20)
    (handle,) = paper.report().handles
    left = float(paper.weights[5, 0])
    assert not handle.arrived
    assert handle.missing == pytest.approx(0.4 * (1 - left), rel=1e-5)
    assert f"handle 1 is {handle.missing:.3g} from its target" in str(paper.report())


def test_a_handle_that_fixed_points_hold_is_told_nothing_of_others(paper):
    paper.add(5, translation=(0, 0.4, 0), reach=0.1)
    paper.add(900, translation=(0, 0.4, 0), reach=0.1)
    paper.fix(20)
    report = paper.report()
    assert not all(handle.arrived for handle in report.handles)
    assert report.advice is None


def test_mirrored_handles_are_named(deformer, mesh):
    vertex = int(mesh.vertices[:, 0].argmax())
    deformer.add(vertex, translation=(0, 0.1, 0))
    deformer.symmetry = "x"
    (handle,) = deformer.report().handles
    np.testing.assert_allclose(handle.mirrored, mesh.vertices[vertex] * [-1, 1, 1], atol=1e-6)
    assert ", mirrored at -0." in str(deformer.report())
    deformer.change(1, at=int(np.abs(mesh.vertices[:, 0]).argmin()))
    assert deformer.report().handles[0].mirrored is None


def test_a_region_and_a_point_are_judged_by_a_vertex(deformer, mesh):
    deformer.add("y>0.7", translation=(0, 0.2, 0))
    (handle,) = deformer.report().handles
    assert mesh.vertices[handle.vertex, 1] > 0.7
    assert handle.arrived
    deformer.change(1, at=mesh.vertices[70] + 1e-5)
    assert deformer.report().handles[0].vertex == 70


@pytest.mark.parametrize(
    ("change", "warning"),
    [
        (lambda d: None, "nothing moved: there is no handle"),
        (lambda d: d.add(5), "nothing moved: no handle is moved, turned or scaled"),
        (lambda d: d.add(5, translation=(1, 0, 0), strength=0), "nothing moved: the strength of every handle is 0"),
        (lambda d: d.add(5, translation=(1e-9, 0, 0)), "nothing moved: all weights are 0, or the motions"),
    ],
)
def test_where_nothing_moves_it_says_why(deformer, change, warning):
    change(deformer)
    report = deformer.report()
    assert report.moved == 0
    assert report.warning.startswith(warning)
    assert str(report) == report.warning


def test_a_share_in_percent_is_0_only_if_it_is_0():
    told = [percent(0.0), percent(0.007), percent(0.012), percent(0.0163, 1), percent(0.0004, 1)]
    assert told == ["0 %", "less than 1 %", "1 %", "1.6 %", "less than 0.1 %"]


def test_little_is_not_nothing(mesh, field):
    features = np.zeros((len(mesh.vertices), 16), np.float32)
    features[:, 0], features[5] = 1, np.eye(16)[1]
    deformer = dfd.Deformer(mesh, field, features=features)
    deformer.add(5, translation=(0, 1, 0))
    assert str(deformer.report()).startswith("moved less than 1 % of the vertices, up to 1, and stretched ")


def test_a_negative_scale_is_told_to_mirror(deformer):
    deformer.add(5, scale=(1, -1, 1))
    assert str(deformer.report()).endswith(
        "handle 1 mirrors the held part, so its faces look inward: a factor of scale is negative"
    )
    deformer.move(1, scale=(-1, -1, 1))  # two negative factors are a rotation by 180°
    assert deformer.report().advice is None


def test_the_largest_stretch_is_that_of_moved_edges_that_are_not_tiny():
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (5, 0, 0), (6, 0, 0), (5, 1, 0), (0, 1, 1e-7)])
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (0, 3, 7)], np.int32)
    assert largest_stretch(corners, corners, faces) == 1
    posed = corners.copy()
    posed[2, 1], posed[7, 2] = 3, 0.5
    assert largest_stretch(corners, posed, faces) == pytest.approx(3)
    assert largest_stretch(corners, 4 * corners + 0.5, faces) == pytest.approx(4)


@pytest.mark.parametrize(("scale", "mentioned"), [(1.04, False), (1.06, True), (1.5, True)])
def test_edges_that_become_longer_by_five_percent_are_mentioned(deformer, scale, mentioned):
    deformer.add("y>-1", scale=scale, reach=2.0, falloff="constant", follow="none")
    report = deformer.report()
    assert report.stretch == pytest.approx(scale)
    assert (f"stretched edges up to {scale:.1f} times" in str(report)) == mentioned


def test_the_level_with_an_axis_is_the_nearest_of_all(quadruped_sample):
    mesh, labels = quadruped_sample.mesh, quadruped_sample.labels
    given = dfd.Deformer(mesh, dfd.VertexField(mesh, np.eye(len(quadruped_sample.parts), dtype=np.float32)[labels]))
    for vertex in (1078, 1848):  # on the neck, which has an axis at the highest level, and on a leg
        lowest, highest = given.bound.parts.levels(vertex)
        handle = given.add(vertex, level=lowest)
        found = level_with_axis(given.bound, given.edit, given.handle(handle))
        slender = []
        for level in range(lowest, highest + 1):
            given.change(handle, level=level)
            parts = bendable_parts(given.bound, given.edit, given.handle(handle))
            slender += [level] if parts and parts[0].slender else []
        assert found == min(slender, default=None)
        given.remove(handle)


def test_who_bends_a_part_without_an_axis_is_told_a_level_that_has_one(quadruped_sample):
    mesh, labels = quadruped_sample.mesh, quadruped_sample.labels
    given = dfd.Deformer(mesh, dfd.VertexField(mesh, np.eye(len(quadruped_sample.parts), dtype=np.float32)[labels]))

    def bent(at, level):
        while given.handles:
            given.remove(given.handles[0].id)
        given.bend(given.add(at, level=level), 40)
        return str(given.report())

    named, notes = set(), []
    for at, level in [
        ("bottom", -1),
        ("0,0.7,0", -2),
        ("0,0.7,0", -1),
        ("0,0.55,0.2", -1),
        ("0,0.55,0.2", 0),
        (401, -2),
    ]:
        try:
            said = bent(at, level)
            notes.append(said)
        except ValueError as error:
            said = str(error)
        named |= {(at, int(found)) for found in re.findall(r"level (-?\d+) has one", said)}
    assert len(named) >= 2
    assert any(re.search(r"could bend \(level -?\d+ has one\)", said) for said in notes)
    assert all("turned as a whole" not in bent(at, level) for at, level in named)


def test_the_stretch_does_not_depend_on_the_unit():
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], float)
    posed = corners * (1, 3, 1)
    for unit in (1e-9, 1.0, 1e9):
        assert largest_stretch(unit * corners, unit * posed, np.array([(0, 1, 2)])) == pytest.approx(3)
