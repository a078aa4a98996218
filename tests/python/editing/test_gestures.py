"""Test what users expect of every gesture: handles arrive, drags do not jump, seams stay closed, steps come back."""

import numpy as np
import pytest
from made_field import field_of, looks

import dfd
from dfd.app.options import SAMPLE_FIELDS
from dfd.editing.report import largest_stretch
from dfd.editing.weights.fill import STEEPEST, STRAIN, band_of, weights_at
from dfd.editing.weights.held_part import BEYOND, INSIDE, hold
from dfd.geometry.coarse import nodes_of
from dfd.geometry.topology import vertex_areas


@pytest.fixture(scope="module")
def animal():
    """Return a sample of a quadruped, a session that gives its parts to the others, and the features."""
    sample = dfd.samples.quadruped(4000)
    rows = looks(sample)
    return sample, dfd.Deformer(sample.mesh, field_of(sample.mesh), features=rows), rows


def fresh(known, edit=None):
    """Return a new session on the shape of `known`, with `edit`."""
    session = dfd.Deformer(known.mesh, known.field, features=known.features)
    session.bound.prepare(known.bound._planes, known.bound.parts)
    if edit is not None:
        session.apply(edit)
    return session


def tip_of(sample, part, number=0):
    """Return the vertex of a part that is farthest from the middle of the shape."""
    own = sample.vertices_of(part, number)
    return int(own[np.linalg.norm(sample.mesh.vertices[own] - sample.mesh.vertices.mean(axis=0), axis=1).argmax()])


@pytest.mark.parametrize("turn", [(0, 0, 0), (0, 60, 0)])
def test_a_drag_of_half_a_diagonal_never_jumps_and_equals_a_fresh_session(animal, turn):
    sample, known, _ = animal
    session, far = fresh(known), sample.mesh.diagonal / 2
    for part, direction in (("leg", (1, 0, 0)), ("head", (0, 0.6, 0.8)), ("tail", (0.6, 0, -0.8))):
        handle, before, largest = session.add(tip_of(sample, part)), session.vertices, 0.0
        for step in range(1, 101):
            share = step / 100
            session.move(handle, translation=far * share * np.array(direction), merge=step > 1)
            if any(turn):
                session.move(handle, rotation=share * np.array(turn), pivot="point", merge=True)
            now = session.vertices
            largest, before = max(largest, float(np.linalg.norm(now - before, axis=1).max())), now
        assert largest <= (3 if not any(turn) else 6) * far / 100
        np.testing.assert_allclose(fresh(known, session.edit).vertices, now, atol=1e-12)
        session.remove(handle)


PULL, SHRINK = (0.5, 0.3, 0.0), (1.5, -2.49)  # the scale passes 0
SWEEPS = {
    "translation": lambda t: {"translation": np.multiply(t, PULL)},
    "rotation to 360° about x": lambda t: {"rotation": (360 * t, 0, 0)},
    "rotation to 360° about y": lambda t: {"rotation": (0, 360 * t, 0)},
    "scale": lambda t: {"scale": SHRINK[0] + SHRINK[1] * t},
    "scale of one axis": lambda t: {"scale": (SHRINK[0] + SHRINK[1] * t, 1, 1)},
    "bend": lambda t: {"bend": (0, 0, 360 * t)},
}
COMBINED = {
    "translation, rotation and scale": ("translation", "rotation to 360° about x", "scale"),
    "all four": ("translation", "rotation to 360° about y", "scale of one axis", "bend"),
}


@pytest.mark.parametrize(
    ("name", "second"),
    [*((name, None) for name in SWEEPS), *((name, part) for name in COMBINED for part in ("leg", "head"))],
)
def test_a_sweep_has_even_steps(animal, name, second):
    sample, session = animal[0], fresh(animal[1])
    first = session.add(tip_of(sample, "leg"))
    if second is not None:
        other = session.add(tip_of(sample, second, second == "leg"))
        session.move(other, translation=(0, 0.05, 0.1), rotation=(20, 10, 0))
    shapes = []
    for t in np.linspace(0, 1, 61):
        motions = [SWEEPS[each](t) for each in COMBINED.get(name, (name,))]
        session.move(first, **{key: value for motion in motions for key, value in motion.items()}, merge=True)
        shapes.append(session.vertices)
    steps = np.abs(np.diff(shapes, axis=0)).max(axis=(1, 2))
    assert steps.max() < 5 * np.median(steps)


@pytest.mark.parametrize("follow", ["all", "none"])
def test_a_part_of_a_rotated_part_moves_as_far_as_its_handle(animal, follow):
    sample, known, _ = animal
    session = fresh(known)
    hoof, leg = tip_of(sample, "hoof"), tip_of(sample, "leg")
    outer = session.add(leg, level=1, rotation=(10, 50, 20), follow=follow)
    carried, pull = session.vertices[hoof], np.array((0.1, 0.05, -0.08))
    inner = session.add(hoof, level=-1, translation=1e-9 * pull, follow=follow)
    np.testing.assert_allclose(session.vertices[hoof], carried, atol=1e-7)
    for step in (1, 2, 3):
        session.move(inner, translation=step * pull)
        np.testing.assert_allclose(session.vertices[hoof], carried + step * pull, atol=1e-7)
    first, second = session.report().handles
    assert (first.arrived, second.arrived, second.along_with) == (True, True, (outer,))
    session.move(inner, rotation=(0, 0, 30), scale=1.5, pivot="point")
    np.testing.assert_allclose(session.vertices[hoof], carried + 3 * pull, atol=1e-7)
    session.move(outer, rotation=(0, 30, 0))
    np.testing.assert_allclose(fresh(known, session.edit).vertices, session.vertices, atol=1e-12)


CONTROLS = (
    {"counterparts": "shared_pivot"},
    {"follow": "none"},
    {"strength": 0.6},
    {"locality": 2.0},
    {"radius": 0.5},
    {"reach": 0.8},
    {"level": -1},
    {"level": 1},
    {"mask": "y>0", "mask_feather": 0.1},
)


@pytest.mark.parametrize(
    ("controls", "how"),
    [
        *((controls, {}) for controls in CONTROLS),
        *(({}, how) for how in ({}, {"symmetry": "x"}, {"default": (0, 0.1, 0)}, {"fixed": "tail"})),
    ],
    ids=str,
)
def test_a_drag_equals_a_fresh_session_and_undo_restores_the_same_bits(animal, controls, how):
    sample, known, _ = animal
    session = fresh(known)
    session.symmetry = how.get("symmetry")
    if "default" in how:
        session.set_default(translation=how["default"])
    if "fixed" in how:
        session.fix(tip_of(sample, "tail"), strength=0.5)
    handles = [session.add(tip_of(sample, part), **controls) for part in ("leg", "ear", "head")]
    session.move(handles[0], translation=(0, -0.05, 0))
    rest = session.vertices
    for step in (1, 2, 3):
        session.move(handles[1], translation=(0, 0.05 * step, 0), rotation=(0, 0, 5 * step), merge=step > 1)
        dragged = session.vertices
    np.testing.assert_allclose(fresh(known, session.edit).vertices, dragged, atol=1e-12)
    session.undo()
    np.testing.assert_array_equal(session.vertices, rest)
    session.redo()
    np.testing.assert_array_equal(session.vertices, dragged)


def test_a_mirrored_gesture_gives_the_mirrored_shape():
    """Two equal horns on a plate, as components of one part, are grabbed left, and then right."""
    mesh, horns, pairs = horned_plate()
    left, right = (int(np.where(horns == k, mesh.vertices[:, 1], -1).argmax()) for k in (0, 1))
    planes, weights = (dfd.SymmetryPlane((1.0, 0.0, 0.0), 0.0),), (horns >= 0).astype(np.float32)
    shapes = []
    for vertex, own, sign in ((left, 0, 1), (right, 1, -1)):
        component = np.where(horns < 0, -1, np.where(horns == own, 0, 1))
        held = hold(mesh, component, vertex, mesh.vertices[vertex], weights, planes)
        pull = np.column_stack([np.eye(3), (0.1 * sign, 0.2, 0.05)])
        posed = mesh.vertices.copy()
        for each in held.components:
            affine = each.counterpart.transform(pull, mesh.vertices[vertex])
            band = band_of(each, affine, np.eye(3, 4), mesh.diagonal)
            some = np.concatenate([each.core.vertices, each.vertices])
            weight = np.concatenate([each.core.values, each.share * weights_at(each.depth, band)])
            posed[some] += weight[:, None] * (affine[:, 3] + posed[some] @ (affine[:, :3] - np.eye(3)).T)
        shapes.append(posed)
    np.testing.assert_allclose(shapes[1][pairs] * (-1, 1, 1), shapes[0], atol=1e-3 * mesh.diagonal)
    assert np.abs(shapes[0] - mesh.vertices).max() > 0.2


def horned_plate(side=41):
    """Return a plate with two equal horns, the horn (V,) of each vertex or −1, and the mirror image of each vertex."""
    line = np.linspace(-1, 1, side)
    x, z = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    away = np.stack([np.hypot(x - at, z) for at in (-0.5, 0.5)])
    height = 0.6 * np.clip(1 - away.min(axis=0) / 0.26, 0, 1)
    horns = np.where(away.min(axis=0) < 0.26, away.argmin(axis=0), -1)
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = (each.ravel() for each in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    left = np.stack([a, c, b, a, d, c], axis=1).reshape(-1, 3)
    right = np.stack([a, d, b, b, d, c], axis=1).reshape(-1, 3)
    on_left = x[left].mean(axis=1) < 0
    faces = np.concatenate([left[on_left], right[x[right].mean(axis=1) > 0]])
    return dfd.Mesh(np.stack([x, height, z], axis=1), faces), horns, index[::-1].ravel()


def test_twelve_moving_handles_reuse_what_they_hold(animal):
    sample, known, _ = animal
    session = fresh(known)
    places = np.linspace(0, len(sample.mesh.vertices) - 1, 40).astype(int)
    handles = [session.add(int(at), translation=(0, 0.01 * (1 + number), 0)) for number, at in enumerate(places)]
    _ = session.vertices
    held = [session.bound.held(session.edit, handle) for handle in session.handles]
    session.move(handles[3], translation=(0.1, 0, 0))
    _ = session.vertices
    assert all(session.bound.held(session.edit, each) is one for each, one in zip(session.handles, held, strict=True))


@pytest.mark.parametrize(("follow", "legs"), [("all", 4), ("mirror", 2), ("none", 1)])
def test_follow_says_how_many_legs_move(follow, legs):
    sample = dfd.samples.quadruped()
    session = dfd.Deformer(sample.mesh, dfd.Field.load(SAMPLE_FIELDS / "quadruped.field.safetensors"))
    session.add(tip_of(sample, "hoof"), translation=(0, -0.2, 0), follow=follow)
    moved = np.linalg.norm(session.vertices - sample.mesh.vertices, axis=1) > 0.19
    hoofs = [moved[sample.vertices_of("hoof", number)] for number in range(4)]
    assert [bool(each.any()) for each in hoofs].count(True) == legs
    assert [bool(each.all()) for each in hoofs].count(True) == legs


@pytest.mark.parametrize("gap", [0.0, 1e-5, 1e-3])
def test_a_seam_stays_closed(animal, gap):
    """Cut the shape along a plane through the head, and move one half a little, as quantization does."""
    sample, _, rows = animal
    mesh = sample.mesh
    own = sample.vertices_of("head")
    cut = mesh.vertices[own].mean(axis=0)[2]
    below = mesh.vertices[mesh.faces].mean(axis=1)[:, 2] < cut
    low, high = np.unique(mesh.faces[below]), np.unique(mesh.faces[~below])
    number = np.full((2, len(mesh.vertices)), -1)
    number[0, low], number[1, high] = np.arange(len(low)), len(low) + np.arange(len(high))
    vertices = np.concatenate([mesh.vertices[low], mesh.vertices[high] + (0, 0.9 * gap * mesh.diagonal, 0)])
    torn = dfd.Mesh(vertices, np.concatenate([number[0][mesh.faces[below]], number[1][mesh.faces[~below]]]))
    both = np.intersect1d(low, high)
    session = dfd.Deformer(torn, field_of(torn), features=np.concatenate([rows[low], rows[high]]))
    for part in ("head", "leg", "ear"):
        tip = tip_of(sample, part)
        pull = 0.2 * mesh.diagonal
        handle = session.add(int(number[:, tip].max()), translation=(pull, 0, 0))
        open_by = np.linalg.norm(session.vertices[number[0, both]] - session.vertices[number[1, both]], axis=1)
        assert open_by.max() <= gap * mesh.diagonal + 0.02 * pull + 1e-9
        session.remove(handle)


def test_vertices_without_faces_follow_the_nearest_surface(animal):
    sample, _, rows = animal
    mesh, tip = sample.mesh, tip_of(sample, "head")
    own = sample.vertices_of("head")[::7]
    for off in (1e-6, 1e-4, 1e-2):
        stray = mesh.vertices[own] + off * mesh.normals[own]
        whole = dfd.Mesh(np.concatenate([mesh.vertices, stray]), mesh.faces)
        session = dfd.Deformer(whole, field_of(whole), features=np.concatenate([rows, rows[own]]))
        session.add(tip, translation=(0.3, 0, 0))
        moved = session.vertices - whole.vertices
        near = np.linalg.norm(moved[len(mesh.vertices) :] - moved[own], axis=1)
        assert np.median(near) < 1e-3
        assert near.max() < 0.15


def test_the_band_keeps_its_limits(animal):
    sample, known, _ = animal
    mesh, session = sample.mesh, fresh(known)
    areas = vertex_areas(mesh.vertices, mesh.faces)
    for part in ("leg", "ear", "head", "tail"):
        tip = tip_of(sample, part)
        handle = session.add(tip)
        held = session.bound.held(session.edit, session.handle(handle))
        rest = session.following[:, 0]
        inside = held.component_of_node[nodes_of(mesh).of_vertex] >= 0
        for size in (0.01, 0.1, 0.5):
            session.move(handle, translation=(size * mesh.diagonal, 0, 0))
            weights = session.following[:, 0]
            assert areas[(weights > 1e-3) & ~inside].sum() <= (BEYOND + 0.03) * areas[~inside].sum()
            for band, component in zip(session.bound.bands(session.edit), held.components, strict=True):
                assert band.outward <= component.outward
                assert band.inward <= component.inward <= INSIDE * component.depth.max(initial=np.inf) + 1e-6
                asked = size * mesh.diagonal * STEEPEST / STRAIN
                wide = band.outward + band.inward
                at_limit = band.outward == component.outward or band.inward == component.inward
                assert wide >= 0.4 * asked or at_limit
        assert (rest[tip], weights[tip]) == (1.0, 1.0)
        session.remove(handle)


def test_the_band_does_not_cross_a_gap_between_two_surfaces():
    """Two plates, one close above the other without contact: a motion of the upper one leaves the lower one still."""
    mesh, horns, _ = horned_plate()
    count = len(mesh.vertices)
    gap = 0.01 * mesh.diagonal
    both = dfd.Mesh(
        np.concatenate([mesh.vertices, mesh.vertices - (0, gap, 0)]), np.concatenate([mesh.faces, mesh.faces + count])
    )
    component = np.concatenate([np.where(horns == 0, 0, -1), np.full(count, -1)])
    tip = int(mesh.vertices[:, 1].argmax())
    held = hold(both, component, tip, both.vertices[tip])
    (own,) = held.components
    assert max(own.vertices.max(), own.core.vertices.max()) < count
    assert own.vertices.size > 0


def test_bends_of_counterparts_neither_crack_nor_stretch_much(animal):
    sample, known, _ = animal
    session = fresh(known)
    for part in ("leg", "ear", "tail", "head"):
        handle = session.add(tip_of(sample, part), bend=60)
        stretch = largest_stretch(sample.mesh.vertices, session.vertices, sample.mesh.faces)
        assert session.report().stretch == stretch
        assert stretch <= 3, part
        session.remove(handle)


def test_two_regions_with_one_middle_share_their_part(animal):
    sample, known, _ = animal
    session, tip = fresh(known), sample.mesh.vertices[tip_of(sample, "leg")]
    for radius, pull in ((0.02, (0.1, 0, 0)), (0.03, (0, 0.1, 0))):
        session.add(dfd.editing.regions.Ball(tuple(tip), radius), translation=pull)
    assert np.isfinite(session.vertices).all()
    assert session.following.sum(axis=1).max() <= 1 + 1e-6
