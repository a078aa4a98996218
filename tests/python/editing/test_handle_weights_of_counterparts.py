"""Test handles that move several counterparts, each about its own pivot."""

import numpy as np
import pytest
from made_field import field_of, looks

import dfd
from dfd.editing.weights import held_part, session_weights
from dfd.editing.weights.fill import Counterpart
from dfd.export.rig import rig_of
from dfd.posing.transforms import Transform, rotation_matrix
from dfd.segmentation.parts import Parts

PLANE = dfd.SymmetryPlane((1.0, 0.0, 0.0), 0.0)


@pytest.fixture(scope="module")
def sample():
    return dfd.samples.chair(4000)


@pytest.fixture
def asked(sample, mesh, monkeypatch):
    """Make the labeled legs of a chair the components of each part, and return the calls of `find_counterparts`."""
    calls = []

    def legs_from(vertex):
        return sorted(range(4), key=lambda leg: leg != sample.instances[vertex])

    def components(parts, vertex, level=0):
        found = np.full(len(mesh.vertices), -1)
        for number, leg in enumerate(legs_from(vertex)):
            found[sample.vertices_of("leg", leg)] = number
        return found

    def labelled(mesh, component, vertex, position, similar, planes):
        calls.append((vertex, planes))
        found = []
        for number, leg in enumerate(legs_from(vertex)):
            members = sample.vertices_of("leg", leg)
            foot = int(members[mesh.vertices[members, 1].argmin()])
            frame = np.diag([1.0 if leg % 2 == sample.instances[vertex] % 2 else -1.0, 1, 1])
            found.append((number, Counterpart(foot, tuple(mesh.vertices[foot]), frame)))
        return found

    monkeypatch.setattr(Parts, "components", components)
    monkeypatch.setattr(held_part, "find_counterparts", labelled)
    monkeypatch.setattr(session_weights, "symmetry_planes", lambda *_: [PLANE])
    return calls


@pytest.fixture
def field_of_quadruped():
    sample = dfd.samples.quadruped(4000)
    return sample, field_of(sample.mesh), looks(sample)


@pytest.fixture
def session(mesh, field, sample, asked):
    features = np.zeros((len(mesh.vertices), 16), np.float32)
    features[:, 0] = 1
    legs = sample.vertices_of("leg")
    features[legs] = np.eye(16)[1]
    back = legs[sample.instances[legs] >= 2]
    features[back, 1:3] = (np.cos(0.5), np.sin(0.5))
    return dfd.Deformer(mesh, field, features=features)


@pytest.fixture
def foot(sample, mesh):
    members = sample.vertices_of("leg", 0)
    return int(members[mesh.vertices[members, 1].argmin()])


def leg(sample, number):
    return sample.vertices_of("leg", number)


def test_each_counterpart_turns_about_its_own_pivot_in_its_own_frame(session, sample, mesh, asked, foot):
    rotation = (0, 40, 0)
    session.preset = "paper"
    session.add(foot, rotation=rotation, translation=(0.1, 0, 0), counterparts="own_pivot")
    for number in (0, 1):
        members = leg(sample, number)
        turn, sign = rotation_matrix(rotation), 1.0 if number == 0 else -1.0
        frame = np.diag([sign, 1, 1])
        center = mesh.vertices[members[mesh.vertices[members, 1].argmin()]]
        wanted = (mesh.vertices[members] - center) @ (frame @ turn @ frame).T + center + (sign * 0.1, 0, 0)
        np.testing.assert_allclose(session.vertices[members], wanted, atol=1e-6)
    others = np.setdiff1d(np.arange(len(mesh.vertices)), sample.vertices_of("leg"))
    np.testing.assert_allclose(session.vertices[others], mesh.vertices[others], atol=1e-12)
    assert asked == [(foot, [PLANE])]
    assert session.weights.shape[1] == 1
    assert session.report().handles[0].counterparts == 4
    assert "with 3 others, each about its own pivot" in str(session.report())


def test_a_given_pivot_has_the_same_offset_from_each_counterpart_as_from_the_handle(session, sample, mesh, asked, foot):
    offset = np.array([0.05, 0.1, 0.0])
    session.add(foot, scale=2, pivot=mesh.vertices[foot] + offset, counterparts="own_pivot", reach=0.7)
    members = leg(sample, 1)
    pivot = mesh.vertices[members[mesh.vertices[members, 1].argmin()]] + offset * (-1, 1, 1)
    np.testing.assert_allclose(session.vertices[members], pivot + 2 * (mesh.vertices[members] - pivot), atol=1e-6)


@pytest.mark.parametrize("counterparts", ["own_pivot", "shared_pivot"])
def test_equalize_gives_all_counterparts_full_weight(session, sample, mesh, asked, foot, counterparts):
    session.preset = "paper"
    session.add(foot, translation=(0, -0.2, 0), counterparts=counterparts)
    back = leg(sample, 2)
    half = session.vertices[back] - mesh.vertices[back]
    assert 0.05 < -half[:, 1].mean() < 0.15
    session.preset = "default"
    session.change(1, reach=1.0, falloff="linear", counterparts=counterparts)
    np.testing.assert_allclose(session.vertices[back], mesh.vertices[back] - (0, 0.2, 0), atol=1e-6)


@pytest.mark.parametrize("near", [{"locality": 3.0}, {"radius": 1.5}])
def test_equalize_compensates_for_features_and_not_for_distance(session, sample, asked, foot, near):
    session.add(foot, translation=(0, -0.2, 0), reach=0.7)
    full = session.following[:, 0].copy()
    session.change(1, **near)
    legs = sample.vertices_of("leg")
    falloff = session.bound.by_features.near(session.edit, session.handle(1), legs)
    assert falloff[legs == foot] == 1
    np.testing.assert_allclose(session.following[legs, 0], full[legs] * falloff, atol=1e-4)
    assert session.following[leg(sample, 2), 0].max() < 0.7


@pytest.mark.parametrize(("weight", "raised"), [(0.08, 0.08), (0.12, 1.0), (0.18, 1.0)])
def test_equalize_raises_counterparts_with_a_tenth_of_the_handle_s_weight(session, sample, asked, foot, weight, raised):
    apart = np.sqrt(2 - 2 * np.cos(0.5))  # the distance of the features of the back legs from those at the handle
    session.add(foot, translation=(0, -0.2, 0), reach=apart / (1 - weight), falloff="linear")
    np.testing.assert_allclose(session.following[leg(sample, 1), 0], 1, atol=1e-5)
    np.testing.assert_allclose(session.following[leg(sample, 2), 0], raised, atol=1e-3)


def test_counterparts_beyond_the_reach_are_not_counted(session, asked, foot):
    handle = session.add(foot, translation=(0, -0.2, 0), reach=1.0, falloff="linear")
    assert session.report().handles[0].counterparts == 4
    session.change(handle, reach=0.2)
    assert session.report().handles[0].counterparts == 2
    assert "with 1 other, each about" in str(session.report())
    assert len(session.counterparts(handle)) == 4


@pytest.mark.parametrize("reach", ["part", 1.0])
def test_equalize_gives_no_vertex_more_weight_than_the_handle(session, mesh, asked, foot, reach):
    """A fixed point lowers the weights of some counterparts, and `equalize` raises them."""
    session.add(foot, translation=(0, -0.2, 0), reach=reach)
    session.fix(foot + 1, strength=0.5)
    assert session.following.max() <= 1 + 1e-6
    assert (session.vertices[:, 1] >= mesh.vertices[:, 1] - 0.2 - 1e-6).all()


@pytest.mark.parametrize("counterparts", ["own_pivot", "shared_pivot"])
def test_single_counterparts_can_be_excluded(session, sample, mesh, asked, foot, counterparts):
    handle = session.add(foot, translation=(0, -0.2, 0), counterparts=counterparts)
    places = [one.vertex for one, _ in session.counterparts(handle)]
    assert places[0] == foot
    before = session.vertices
    on_leg = leg(sample, 1)
    session.change(handle, excluded_counterparts=[places[1], tuple(mesh.vertices[places[3]])])
    assert [on for _, on in session.counterparts(handle)] == [True, False, True, False]
    for number, moves in enumerate([True, False, True, False]):
        members = leg(sample, number)
        wanted = before[members] if moves else mesh.vertices[members]
        np.testing.assert_allclose(session.vertices[members], wanted, atol=1e-9)
    # Any vertex of a counterpart excludes that counterpart, also if the vertex is given as text.
    session.change(handle, excluded_counterparts=[str(on_leg[5])])
    assert [on for _, on in session.counterparts(handle)] == [True, False, True, True]
    session.change(handle, name="foot")
    assert [on for _, on in session.counterparts(handle)] == [True, False, True, True]
    session.change(handle, excluded_counterparts=[])
    np.testing.assert_allclose(session.vertices, before, atol=1e-12)
    session.undo()
    assert [on for _, on in session.counterparts(handle)] == [True, False, True, True]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (7, r"`excluded_counterparts` must be a list of vertices or points, got 7"),
        ("top", r"`excluded_counterparts` must be a list of vertices or points, got 'top'"),
        (["x>0"], r"`excluded_counterparts` must be a list of vertices or points, got a region"),
        ([10**6], r"`at` must lie in 0"),
    ],
)
def test_values_that_are_no_list_of_places_raise_an_error(session, foot, given, message):
    with pytest.raises(ValueError, match=f"Deformer.add: {message}"):
        session.add(foot, excluded_counterparts=given)


def test_a_leg_follows_the_handle_on_it_instead_of_another_handle(session, sample, mesh, asked):
    feet = [int(members[mesh.vertices[members, 1].argmin()]) for members in (leg(sample, 0), leg(sample, 2))]
    session.add(feet[0], translation=(0, -0.2, 0), reach=0.7)
    session.add(feet[1], translation=(0, -0.1, 0), reach=0.7)
    for number, down in enumerate((0.2, 0.2, 0.1, 0.2)):
        members = leg(sample, number)
        np.testing.assert_allclose(session.vertices[members], mesh.vertices[members] - (0, down, 0), atol=1e-6)
    assert all(handle.arrived for handle in session.report().handles)
    assert session.bound.columns(session.edit)[0].sum(axis=1).max() <= 1 + 1e-6
    session.move(2, translation=(0, 0, 0))  # this handle is at rest, so its leg follows the first handle
    members = leg(sample, 2)
    np.testing.assert_allclose(session.vertices[members], mesh.vertices[members] - (0, 0.2, 0), atol=1e-6)


def test_a_rig_has_the_bands_of_its_widest_pose(mesh, field, sample, foot):
    session = dfd.Deformer(mesh, field, features=np.eye(16, dtype=np.float32)[sample.labels])
    held, far = session.add(foot), (0.3 * mesh.diagonal, 0, 0)
    rig = rig_of(session, [dfd.KeyPose(1.0, {held: Transform(translation=far)})])
    session.move(held, translation=far)
    *_, (_, edit) = rig.moments()
    np.testing.assert_allclose(rig.posed(edit), session.vertices, atol=1e-6)


def test_a_rig_stretches_a_lengthened_limb_although_another_pose_shears_it(mesh, field, sample, foot):
    session = dfd.Deformer(mesh, field, features=np.eye(16, dtype=np.float32)[sample.labels])
    held, far = session.add(foot), 0.1 * mesh.diagonal
    along = session.bound.held(session.edit, session.handle(held)).components[0].direction
    shear, stretch = (Transform(translation=tuple(far * way)) for way in (np.array([1.0, 0, 0]), along))
    bands = {}
    for name, poses in (("shear", [shear]), ("stretch", [stretch]), ("both", [shear, stretch])):
        rig = rig_of(session, [dfd.KeyPose(1.0 + number, {held: pose}) for number, pose in enumerate(poses)])
        bands[name] = np.concatenate([1 - weights[:, rig.default] for _, weights in rig.weights()])
    partial = {name: int(((each > 0.05) & (each < 0.95)).sum()) for name, each in bands.items()}
    assert partial["both"] >= max(partial["stretch"], partial["shear"])
    assert partial["stretch"] != partial["shear"]


def test_the_base_of_a_limb_does_not_depend_on_the_width_of_its_blend_band(mesh, field, sample, foot):
    bases = []
    for translation in ((0, 0, 0), (0.2 * mesh.diagonal, 0, 0)):
        session = dfd.Deformer(mesh, field, features=np.eye(16, dtype=np.float32)[sample.labels])
        held = session.add(foot, translation=translation)
        session.move(held, rotation=(0, 0, 30), pivot="base")
        bases.append(session.handle(held).transform.pivot)
    assert bases[0] == bases[1]


def test_carriers_and_counterparts_do_not_depend_on_how_far_handles_move(field_of_quadruped):
    sample, field, features = field_of_quadruped
    mesh, found = sample.mesh, []
    for amount in (0.002, 0.05, 0.3):
        session = dfd.Deformer(mesh, field, features=features)
        for place, share, direction in ((1280, 0.2, (0, 0, -1)), (420, amount, (-1, 0, 0))):  # the neck and the head
            session.add(place, translation=share * mesh.diagonal * np.array(direction))
        found.append([(each.along_with, each.counterparts) for each in session.report().handles])
    assert all(each == found[0] for each in found)
