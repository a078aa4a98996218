"""What becomes of weights whose sum passes 1, and handles that arrive."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from posing.made_motion import scene, turning_scene

import dfd

OVERLAPS = ("add", "paper", "normalize", "interpolate")
BLENDS = ("linear", "dual_quaternion")
TYPES = pytest.mark.parametrize("dtype", [np.float32, np.float64])
PLANE = dfd.SymmetryPlane((0.6, 0.0, 0.8), 0.25)


@settings(max_examples=60, deadline=None)
@given(
    vertex_count=st.integers(6, 60),
    handle_count=st.integers(1, 6),
    seed=st.integers(0, 2**32 - 1),
    dtype=st.sampled_from([np.float32, np.float64]),
    band=st.sampled_from([None, 0.0, 0.7]),
    with_default=st.booleans(),
    overlap=st.sampled_from(OVERLAPS),
)
def test_agrees_with_the_twin(vertex_count, handle_count, seed, dtype, band, with_default, overlap):
    vertices, weights, transforms = turning_scene(vertex_count, handle_count, seed=seed, dtype=dtype)
    default = np.eye(3, 4) + 0.3 * np.random.default_rng(seed).standard_normal((3, 4)) if with_default else None
    plane = None if band is None else dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=band)
    options = {"default": default, "symmetry": plane, "handles": np.arange(handle_count), "overlap": overlap}
    posed, wanted = (pose(vertices, weights, transforms, **options) for pose in (dfd.pose, reference.pose))
    assert posed.dtype == dtype
    among = np.linalg.cond(weights[:handle_count]) if overlap == "interpolate" else 1.0
    aside = np.abs(vertices @ np.array(PLANE.normal) - PLANE.offset) > 1e-6  # one so close may fall to either side
    scale = max(1.0, np.abs(wanted).max())
    np.testing.assert_allclose(posed[aside], wanted[aside], rtol=0, atol=1e-6 * max(10, among) * scale)


@TYPES
@pytest.mark.parametrize("blend", BLENDS)
@pytest.mark.parametrize("band", [None, 0.0, 1.0])
def test_identity_transforms_leave_every_bit(dtype, blend, band):
    vertices, weights, _ = scene(1000, 5, dtype=dtype)
    vertices = np.vstack([vertices, vertices * 1e-20, vertices + 1e4]).astype(dtype)
    weights = np.tile(weights, (3, 1))
    assert weights.sum(axis=1).max() > 1
    plane = None if band is None else dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=band)
    still = np.tile(np.eye(4), (5, 1, 1))
    for overlap in ("add", "normalize", "interpolate"):
        posed = dfd.pose(vertices, weights, still, symmetry=plane, overlap=overlap, blend=blend)
        np.testing.assert_array_equal(posed, vertices)


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


VERTICES, WEIGHTS, TRANSFORMS = turning_scene(6, 3)
ALIKE, IDLE = WEIGHTS.copy(), WEIGHTS.copy()
ALIKE[2] = ALIKE[0]
IDLE[1] = 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"overlap": "sum"}, r"`overlap` must be one of add, interpolate, normalize, paper, got 'sum'"),
        ({"blend": "cubic"}, r"`blend` must be one of linear, dual_quaternion, got 'cubic'"),
        ({"weights": ALIKE}, r"the handles of columns 0 and 2 have alike weights at their places"),
        ({"weights": IDLE}, r"the handle of column 1 cannot arrive: no weight is above 0 at its place"),
        ({"handles": VERTICES[:3]}, r"`handle_weights` must be given to interpolate handles that are no vertices"),
        ({"handle_weights": np.eye(2)}, r"`handle_weights` must have shape \(3, 3\), got \(2, 2\)"),
        ({"handle_weights": np.full((3, 3), np.nan)}, r"`handle_weights` must be finite, got nan"),
    ],
)
def test_bad_input(arguments, message):
    defaults = {"weights": WEIGHTS, "transforms": TRANSFORMS, "handles": [0, 1, 2], "overlap": "interpolate"}
    for call in (dfd.pose, lambda *a, **k: dfd.Drag(*a, moving=[0], **k)):
        with pytest.raises(ValueError, match="^(pose|Drag): " + message):
            call(VERTICES, **{**defaults, **arguments})
