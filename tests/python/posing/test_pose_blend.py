"""Test `blend` and `overlap`: against the slow reference implementation, and by their purposes."""

import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from posing.made_motion import about, rotation, scene, turning_scene
from scipy.spatial.transform import Rotation

import dfd

OVERLAPS = ("add", "paper", "normalize", "interpolate")
BLENDS = ("linear", "dual_quaternion")
TYPES = pytest.mark.parametrize("dtype", [np.float32, np.float64])
PLANE = dfd.SymmetryPlane((0.6, 0.0, 0.8), 0.25)


@given(
    vertex_count=st.integers(8, 50),
    handle_count=st.integers(1, 8),
    seed=st.integers(0, 2**32 - 1),
    dtype=st.sampled_from([np.float32, np.float64]),
    band=st.sampled_from([None, 0.0, 0.7]),
    with_default=st.booleans(),
    stretch=st.sampled_from([0.0, 0.4]),
    overlap=st.sampled_from(OVERLAPS),
    blend=st.sampled_from(BLENDS),
    turned=st.booleans(),
)
def test_agrees_with_the_twin(
    vertex_count, handle_count, seed, dtype, band, with_default, stretch, overlap, blend, turned
):
    vertices, weights, transforms = turning_scene(vertex_count, handle_count, seed=seed, dtype=dtype, stretch=stretch)
    random = np.random.default_rng(seed)
    normals = random.standard_normal((vertex_count, 3)).astype(dtype)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    options = {
        "default": np.eye(3, 4) + 0.1 * random.standard_normal((3, 4)) if with_default else None,
        "symmetry": None if band is None else dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=band),
        "handles": np.arange(handle_count) if overlap == "interpolate" else vertices[:handle_count] + 0.1,
        "normals": normals,
        "overlap": overlap,
        "blend": blend,
    }
    if turned:  # rotations by up to 260°, whose matrices do not say which way they go
        rotations = random.uniform(-150, 150, (handle_count + 1, 3))
        stretches = random.normal(size=(handle_count + 1, 3, 3))
        stretches = np.eye(3) + 0.3 * stretch * (stretches + stretches.transpose(0, 2, 1))
        linear = Rotation.from_rotvec(rotations, degrees=True).as_matrix() @ stretches
        matrices = np.concatenate([linear, random.normal(size=(handle_count + 1, 3, 1))], axis=2)
        transforms, options["default"] = matrices[:-1], matrices[-1]
        options |= {"pivots": random.normal(size=(handle_count + 1, 3)), "rotations": rotations}
    posed, turned_normals = dfd.pose(vertices, weights, transforms, **options)
    wanted, wanted_normals = reference.pose(vertices, weights, transforms, **options)
    assert posed.dtype == turned_normals.dtype == dtype
    aside = np.abs(vertices @ np.array(PLANE.normal) - PLANE.offset) > 1e-6  # others can be on either side
    # Rotations that nearly cancel leave a quaternion with few digits. So do similar handles with "interpolate".
    lost = max(1.0, np.linalg.cond(weights[:handle_count]) / 10) if overlap == "interpolate" else 1.0
    digits = {"linear": 1e-5, "dual_quaternion": 3e-5}[blend]
    np.testing.assert_allclose(posed[aside], wanted[aside], rtol=0, atol=lost * digits * max(1.0, np.abs(wanted).max()))
    np.testing.assert_allclose(turned_normals[aside], wanted_normals[aside], rtol=0, atol=lost * 3e-4)


@pytest.mark.parametrize("kind", ["flat", "point", "mirrored"])
def test_singular_and_mirrored_transforms_blend_as_in_the_twin(kind):
    random = np.random.default_rng(0)
    for _ in range(20):
        linear = random.standard_normal((3, 3, 3))
        if kind == "flat":
            linear[:, :, 2] = linear[:, :, 0]
        elif kind == "point":
            linear *= 0
        else:
            linear[:, :, 0] *= -np.sign(np.linalg.det(linear))[:, None]
        transforms = np.concatenate([linear, random.standard_normal((3, 3, 1))], axis=2)
        vertices, weights = random.standard_normal((6, 3)), random.random((6, 3)) / 3
        options = {"overlap": "add", "blend": "dual_quaternion"}
        posed = dfd.pose(vertices, weights, transforms, **options)
        np.testing.assert_allclose(posed, reference.pose(vertices, weights, transforms, **options), atol=1e-4)


def test_a_twisted_bar_keeps_its_volume():
    height = np.linspace(0, 1, 101)
    ring = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)])
    bar = np.array([[0.1 * x, 0.1 * y, z] for z in height for x, y in ring])
    weights = np.repeat(height, 12)[:, None].astype(np.float32)
    twist = about([0, 0, 1], rotation([0, 0, 1], np.radians(150)))
    posed = dfd.pose(bar, weights, twist[None], handles=[[0.0, 0, 1]], blend="dual_quaternion")
    radii = np.linalg.norm(posed[:, :2], axis=1)
    np.testing.assert_allclose(radii, 0.1, rtol=1e-6)
    np.testing.assert_allclose(posed[:, 2], bar[:, 2], atol=1e-7)
    linear = np.linalg.norm(dfd.pose(bar, weights, twist[None])[:, :2], axis=1)
    assert linear.min() < 0.03  # the candy-wrapper artifact of a linear blend


def test_rotations_need_pivots():
    with pytest.raises(ValueError, match=r"^pose: `pivots` must be given with `rotations`"):
        dfd.pose(np.zeros((1, 3)), np.ones((1, 1)), [np.eye(3, 4)], blend="dual_quaternion", rotations=np.zeros((2, 3)))


def test_opposite_turns_that_cancel_leave_no_nan():
    vertices, _, _ = scene(64, 0)
    turns = [about([0, 0, 0], rotation([0, 0, 1], sign * np.radians(179))) for sign in (1, -1)]
    for weight in np.linspace(0.3, 0.8, 101):
        posed, normals = dfd.pose(vertices, np.full((64, 2), weight), turns, blend="dual_quaternion", normals=vertices)
        assert np.isfinite(posed).all()
        assert np.isfinite(normals).all()


@TYPES
@pytest.mark.parametrize("handle_count", [1, 7])
@pytest.mark.parametrize("blend", ["linear", "dual_quaternion"])
def test_a_vertex_moves_the_same_wherever_it_stands(dtype, handle_count, blend):
    vertices, weights, transforms = turning_scene(8, handle_count, dtype=dtype)
    order = np.concatenate([[0], np.arange(133) % 8])
    for symmetry in (None, PLANE, dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=1.0)):
        posed = dfd.pose(vertices[order], weights[order], transforms, symmetry=symmetry,
                         handles=vertices[:handle_count], blend=blend)  # fmt: skip
        first = np.array([np.flatnonzero(order == k)[0] for k in range(8)])
        np.testing.assert_array_equal(posed, posed[first][order])


def test_empty_and_single():
    assert dfd.pose(np.zeros((0, 3)), np.zeros((0, 2)), [np.eye(3, 4)] * 2, blend="dual_quaternion").shape == (0, 3)
    assert (
        dfd.pose(np.ones((5, 3)), np.zeros((5, 0)), np.zeros((0, 3, 4)), blend="dual_quaternion").tolist()
        == [[1, 1, 1]] * 5
    )
    turn = about([0, 0, 0], rotation([0, 0, 1], np.pi / 2))
    posed = dfd.pose([[1.0, 0, 0]], [[1.0]], turn[None], handles=[[0.0, 0, 0]], blend="dual_quaternion")
    np.testing.assert_allclose(posed, [[0, 1, 0]], atol=1e-15)


@pytest.mark.parametrize("handle_count", [1, 4])
def test_all_are_equation_1_where_weights_sum_to_at_most_one(handle_count):
    vertices, weights, transforms = scene(200, handle_count)
    weights /= 3
    paper = dfd.pose(vertices, weights, transforms, overlap="paper")
    for overlap in ("add", "normalize"):
        np.testing.assert_array_equal(dfd.pose(vertices, weights, transforms, overlap=overlap), paper)


@TYPES
@pytest.mark.parametrize("blend", BLENDS)
@pytest.mark.parametrize("symmetry", [None, PLANE])
def test_interpolated_handles_reach_targets(dtype, blend, symmetry):
    vertices, weights, transforms = turning_scene(100, 5, dtype=dtype)
    default = np.eye(3, 4)
    default[:, 3] = [1, 2, 3]
    posed = dfd.pose(
        vertices,
        weights,
        transforms,
        default=default,
        symmetry=symmetry,
        handles=np.arange(5),
        overlap="interpolate",
        blend=blend,
    )
    sent = np.einsum("hij,hj->hi", transforms[:, :, :3], vertices[:5]) + transforms[:, :, 3]
    np.testing.assert_allclose(posed[:5], sent, atol=1e-4 if dtype == np.float32 else 1e-6)


def test_weights_among_handles_may_be_given():
    vertices, weights, transforms = turning_scene(60, 4)
    wanted = dfd.pose(vertices, weights, transforms, handles=np.arange(4), overlap="interpolate")
    given_places = dfd.pose(
        vertices, weights, transforms, handles=vertices[:4], handle_weights=weights[:4], overlap="interpolate"
    )
    np.testing.assert_array_equal(given_places, wanted)
    np.testing.assert_array_equal(dfd.pose(vertices, weights, transforms, overlap="interpolate"), wanted)


@TYPES
@pytest.mark.parametrize("blend", BLENDS)
@pytest.mark.parametrize("overlap", OVERLAPS)
@pytest.mark.parametrize("band", [None, 0.7])
def test_a_drag_gives_what_a_pose_gives(dtype, blend, overlap, band):
    vertices, weights, transforms = turning_scene(120, 5, dtype=dtype)
    symmetry = None if band is None else dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=band)
    default = np.eye(3, 4)
    default[:, 3] = [0.1, 0.2, 0.3]
    options = {"default": default, "symmetry": symmetry, "overlap": overlap, "blend": blend}
    before = [array.copy() for array in (vertices, weights, transforms)]
    drag = dfd.Drag(vertices, weights, transforms, [3, 1], **options)
    for seed in range(3):
        moved = transforms.copy()
        moved[[3, 1]] = turning_scene(10, 2, seed=seed)[2]
        wanted = dfd.pose(vertices, weights, moved, **options)
        posed, out = drag.pose(moved[[3, 1]]), np.empty_like(vertices)
        assert posed.dtype == dtype
        np.testing.assert_allclose(posed, wanted, atol=2e-5)
        assert drag.pose(moved[[3, 1]], out=out) is out
        np.testing.assert_array_equal(out, posed)
    for array, kept in zip((vertices, weights, transforms), before, strict=True):
        np.testing.assert_array_equal(array, kept)
        array[:] = 7
    np.testing.assert_array_equal(drag.pose(moved[[3, 1]]), posed, "a drag must keep copies")


VERTICES, WEIGHTS, TRANSFORMS = turning_scene(6, 3)
ALIKE, IDLE = WEIGHTS.copy(), WEIGHTS.copy()
ALIKE[2] = ALIKE[0]
IDLE[1] = 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"overlap": "sum"}, r"`overlap` must be one of add, interpolate, normalize, paper, got 'sum'"),
        ({"blend": "cubic"}, r"`blend` must be one of linear, dual_quaternion, got 'cubic'"),
        ({"weights": ALIKE}, r"the handles of columns 0 and 2 cannot move independently: the weights at their"),
        ({"weights": IDLE}, r"the handle of column 1 cannot move: all weights at its position are 0"),
        ({"handles": VERTICES[:3]}, r"`handle_weights` must be given to interpolate, if `handles` are positions"),
        ({"handle_weights": np.eye(2)}, r"`handle_weights` must have shape \(3, 3\), got \(2, 2\)"),
        ({"handle_weights": np.full((3, 3), np.nan)}, r"`handle_weights` must be finite, got nan"),
    ],
)
def test_bad_input(arguments, message):
    defaults = {"weights": WEIGHTS, "transforms": TRANSFORMS, "handles": [0, 1, 2], "overlap": "interpolate"}
    for call in (dfd.pose, lambda *a, **k: dfd.Drag(*a, moving=[0], **k)):
        with pytest.raises(ValueError, match="^(pose|Drag): " + message):
            call(VERTICES, **{**defaults, **arguments})
