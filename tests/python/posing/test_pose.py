"""Posed vertices against their slow twin, by analysis, and with bad input."""

from __future__ import annotations

import numpy as np
import pytest
import reference
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from posing.made_motion import rotation, scene

import dfd

PLANE = dfd.SymmetryPlane((0.6, 0.0, 0.8), 0.25)
TYPES = pytest.mark.parametrize("dtype", [np.float32, np.float64])


@settings(max_examples=60, deadline=None)
@given(
    vertex_count=st.integers(0, 100),
    handle_count=st.integers(0, 40),
    seed=st.integers(0, 2**32 - 1),
    dtype=st.sampled_from([np.float32, np.float64]),
    band=st.sampled_from([None, 0.0, 0.7]),
    with_default=st.booleans(),
)
def test_agrees_with_the_twin(vertex_count, handle_count, seed, dtype, band, with_default):
    vertices, weights, transforms = scene(vertex_count, handle_count, seed=seed, dtype=dtype)
    default = np.eye(3, 4) + 0.3 * np.random.default_rng(seed).standard_normal((3, 4)) if with_default else None
    if band is None:
        posed = dfd.pose(vertices, weights, transforms, default=default)
        wanted = reference.pose(vertices, weights, transforms, default=default)
    else:
        plane = dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=band)
        places = np.random.default_rng(seed + 1).standard_normal((handle_count, 3))
        posed = dfd.pose(vertices, weights, transforms, default=default, symmetry=plane, handles=places)
        if band == 0:  # a vertex this close to the plane may fall to either side
            keep = np.abs(vertices @ np.array(plane.normal) - plane.offset) > 1e-6
            vertices, weights, posed = vertices[keep], weights[keep], posed[keep]
        wanted = reference.pose(vertices, weights, transforms, default=default, symmetry=plane, handles=places)
    assert posed.dtype == dtype
    assert posed.flags.c_contiguous
    np.testing.assert_allclose(posed, wanted, rtol=0, atol=1e-5 * max(1.0, np.abs(wanted).max(initial=0)))


@TYPES
def test_identity_gives_the_input_back(dtype):
    vertices, weights, _ = scene(1000, 5, dtype=dtype)
    weights /= 3
    vertices += 1e4
    for symmetry in (None, PLANE, dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=1.0)):
        posed = dfd.pose(vertices, weights, np.tile(np.eye(4), (5, 1, 1)), symmetry=symmetry)
        np.testing.assert_allclose(posed, vertices, rtol=1e-15, atol=0)


@TYPES
def test_weight_one_moves_rigidly_and_weight_zero_stays(dtype):
    vertices, _, _ = scene(200, 0, dtype=dtype)
    weights = (np.arange(200) % 2).astype(np.float32)[:, None]
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = rotation([1, 2, 3], 1.0), [0.5, -1, 2]
    posed = dfd.pose(vertices, weights, turn[None])
    np.testing.assert_array_equal(posed[::2], vertices[::2])
    moved = vertices[1::2] @ turn[:3, :3].T + turn[:3, 3]
    np.testing.assert_allclose(posed[1::2], moved, rtol=0, atol=2e-6)


def test_default_moves_what_the_weights_leave():
    vertices, _, _ = scene(50, 0)
    weights = np.full((50, 1), 0.25, np.float32)
    shift = np.eye(3, 4)
    shift[:, 3] = 4
    posed = dfd.pose(vertices, weights, np.eye(3, 4)[None], default=shift)
    np.testing.assert_allclose(posed, vertices + 3, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(
        posed, dfd.pose(vertices, weights, np.eye(3, 4)[None], default=np.vstack([shift, [0, 0, 0, 1]]))
    )


def test_far_from_the_origin_a_turn_loses_no_digits():
    vertices, weights, _ = scene(500, 2)
    weights /= 3
    center = np.array([5e5, -3e5, 1e6])
    turns = np.zeros((2, 3, 4))
    for k, angle in enumerate((0.8, -0.3)):
        turns[k, :, :3] = rotation([1, k, 2], angle)
        turns[k, :, 3] = center - turns[k, :, :3] @ center
    far = (vertices.astype(np.float64) + center).astype(np.float32)
    posed = dfd.pose(far, weights, turns)
    wanted = reference.pose(far.astype(np.float64), weights, turns)
    assert np.abs(posed - wanted).max() <= 0.5 * np.spacing(np.abs(far).max()) + 1e-5


@TYPES
def test_mirrored_mesh_deforms_to_its_mirror_image(dtype):
    half, weights, transforms = scene(300, 3, dtype=dtype)
    half = half.astype(np.float64)
    half += np.outer(PLANE.offset + np.abs(half @ PLANE.normal) + 0.01 - half @ PLANE.normal, PLANE.normal)
    reflected = half - 2 * np.outer(half @ PLANE.normal - PLANE.offset, PLANE.normal)
    vertices = np.vstack([half, reflected]).astype(dtype)
    places = vertices[[0, 310, 20]]
    posed = dfd.pose(vertices, np.vstack([weights, weights]), transforms, symmetry=PLANE, handles=places, overlap="add")
    mirrored = posed[:300] - 2 * np.outer(posed[:300] @ PLANE.normal - PLANE.offset, PLANE.normal)
    np.testing.assert_allclose(posed[300:], mirrored, rtol=0, atol=2e-5)


def test_band_leaves_no_crease():
    heights = np.linspace(-0.5, 0.5, 2001)
    vertices = np.column_stack([heights, np.zeros((2001, 2))])
    weights = np.full((2001, 1), 0.8, np.float32)
    push = np.eye(3, 4)
    push[0, 3] = 1.0
    jumps = {}
    for band in (0.0, 0.2):
        plane = dfd.SymmetryPlane((1.0, 0.0, 0.0), 0.0, band=band)
        posed = dfd.pose(vertices, weights, push[None], symmetry=plane, handles=[[1.0, 0, 0]])
        np.testing.assert_allclose(posed[heights > 0.21, 0], heights[heights > 0.21] + 0.8, atol=1e-6)
        np.testing.assert_allclose(posed[heights < -0.21, 0], heights[heights < -0.21] - 0.8, atol=1e-6)
        jumps[band] = np.abs(np.diff(posed[:, 0])).max()
    assert jumps[0.0] > 1.5
    assert jumps[0.2] < 0.01


def test_a_handle_without_a_place_stands_where_it_weighs_most():
    vertices, weights, transforms = scene(100, 3)
    strongest = weights.argmax(axis=0)
    np.testing.assert_array_equal(
        dfd.pose(vertices, weights, transforms, symmetry=PLANE),
        dfd.pose(vertices, weights, transforms, symmetry=PLANE, handles=strongest),
    )
    np.testing.assert_array_equal(
        dfd.pose(vertices, weights, transforms, symmetry=PLANE, handles=strongest),
        dfd.pose(vertices, weights, transforms, symmetry=PLANE, handles=vertices[strongest]),
    )


@TYPES
@pytest.mark.parametrize("handle_count", [1, 7])
def test_a_vertex_moves_the_same_wherever_it_stands(dtype, handle_count):
    vertices, weights, transforms = scene(4, handle_count, dtype=dtype)
    order = np.concatenate([[0], np.arange(130) % 4])
    places = vertices[:1].repeat(handle_count, 0)
    for symmetry in (None, PLANE, dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=1.0)):
        posed = dfd.pose(vertices[order], weights[order], transforms, symmetry=symmetry, handles=places)
        first = np.array([np.flatnonzero(order == k)[0] for k in range(4)])
        np.testing.assert_array_equal(posed, posed[first][order])


def test_inputs_stay_and_out_is_filled():
    vertices, weights, transforms = scene(40, 3)
    for array in (vertices, weights, transforms):
        array.flags.writeable = False
    out = np.empty((40, 3), np.float32)
    assert dfd.pose(vertices, weights, transforms, out=out) is out
    np.testing.assert_array_equal(out, dfd.pose(vertices, weights, transforms))


def test_weights_may_be_stored_column_by_column():
    vertices, weights, transforms = scene(53, 5)
    wanted = dfd.pose(vertices, weights, transforms)
    columns = np.full((7, 53), np.nan, np.float32)
    columns[1:6] = weights.T
    np.testing.assert_array_equal(dfd.pose(vertices, columns[1:6].T, transforms), wanted)
    rows = np.full((53, 9), np.nan, np.float32)
    rows[:, 2:7] = weights
    np.testing.assert_array_equal(dfd.pose(vertices, rows[:, 2:7], transforms), wanted)


@TYPES
def test_normals_turn_with_the_surface(dtype):
    vertices, weights, transforms = scene(211, 3, dtype=dtype)
    random = np.random.default_rng(5)
    tangents = np.linalg.qr(random.standard_normal((211, 3, 3)))[0]
    first, second, normals = tangents[:, :, 0], tangents[:, :, 1], tangents[:, :, 2]
    normals = np.cross(first, second).astype(dtype)
    plane = dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=0.5)
    posed, turned = dfd.pose(vertices, weights, transforms, symmetry=plane, normals=normals)
    np.testing.assert_array_equal(posed, dfd.pose(vertices, weights, transforms, symmetry=plane))
    assert turned.dtype == dtype
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1, atol=1e-5)
    # Away from the band the weights stay as they are, so tangents move as differences of vertices do.
    places = vertices[weights.argmax(axis=0)]
    aside = np.abs(vertices @ np.array(plane.normal) - plane.offset) > 0.6
    moved = [
        reference.pose(vertices + 1e-3 * sign * tangent, weights, transforms, symmetry=plane, handles=places)
        for tangent in (first, second)
        for sign in (1, -1)
    ]
    wanted = np.cross(moved[0] - moved[1], moved[2] - moved[3])
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    np.testing.assert_allclose(turned[aside], wanted[aside], atol=1e-4)


def test_a_part_squeezed_flat_keeps_its_normals():
    vertices, _, _ = scene(40, 0)
    normals = np.tile(np.array([[0.0, 0.6, 0.8]], np.float32), (40, 1))
    posed, turned = dfd.pose(vertices, np.ones((40, 1)), np.zeros((1, 3, 4)), normals=normals)
    np.testing.assert_allclose(posed, 0, atol=1e-6)
    np.testing.assert_array_equal(turned, normals)


@TYPES
@pytest.mark.parametrize("band", [None, 0.0, 0.7])
def test_a_drag_gives_what_a_pose_gives(dtype, band):
    vertices, weights, transforms = scene(300, 9, dtype=dtype)
    symmetry = None if band is None else dfd.SymmetryPlane(PLANE.normal, PLANE.offset, band=band)
    default = np.eye(3, 4)
    default[:, 3] = [0.1, 0.2, 0.3]
    drag = dfd.Drag(vertices, weights, transforms, [6, 2], default=default, symmetry=symmetry)
    for seed in range(3):
        moved = transforms.copy()
        moved[[6, 2]] = scene(0, 2, seed=seed)[2]
        wanted = dfd.pose(vertices, weights, moved, default=default, symmetry=symmetry)
        posed = drag.pose(moved[[6, 2]])
        assert posed.dtype == dtype
        np.testing.assert_allclose(posed, wanted, rtol=0, atol=1e-5 if dtype == np.float32 else 1e-12)
        out = np.empty_like(posed)
        assert drag.pose(moved[[6, 2]], out=out) is out
        np.testing.assert_array_equal(out, posed)


@pytest.mark.parametrize(
    ("moving", "message"), [([2], r"`moving` must lie in 0 … 1, got 2"), ([0, 0], r"`moving` names .* more than once")]
)
def test_drag_refuses_bad_handles(moving, message):
    with pytest.raises(ValueError, match="^Drag: " + message):
        dfd.Drag(VERTICES, WEIGHTS, TRANSFORMS, moving)


def test_drag_refuses_bad_transforms():
    with pytest.raises(
        ValueError, match=r"^Drag.pose: `transforms` must have shape \(1, 3, 4\) or .*, got \(2, 3, 4\)"
    ):
        dfd.Drag(VERTICES, WEIGHTS, TRANSFORMS, [1]).pose(TRANSFORMS)


def test_torch_tensors_share_their_memory():
    vertices, weights, transforms = (torch.from_numpy(array) for array in scene(40, 3))
    posed = dfd.pose(vertices, weights, transforms, default=torch.eye(4))
    assert isinstance(posed, torch.Tensor)
    np.testing.assert_array_equal(posed.numpy(), dfd.pose(*scene(40, 3)))
    out = torch.empty(40, 3)
    assert dfd.pose(vertices, weights, transforms, out=out) is out


def test_other_types_and_layouts_are_taken():
    vertices, weights, transforms = scene(40, 3, dtype=np.float64)
    wanted = dfd.pose(vertices, weights, transforms)
    np.testing.assert_array_equal(dfd.pose(np.asfortranarray(vertices), weights[::-1][::-1], transforms), wanted)
    np.testing.assert_array_equal(dfd.pose(vertices.tolist(), weights.astype(np.float64), transforms), wanted)
    assert dfd.pose(np.arange(9).reshape(3, 3), np.ones((3, 1)), np.eye(3, 4)[None]).dtype == np.float64
    for dtype in (np.float16, ">f4"):
        assert dfd.pose(np.zeros((3, 3), dtype), np.ones((3, 1)), np.eye(3, 4)[None]).dtype == np.float32
    for count in (1, 3):  # strided weights are copied, also of one vertex
        strided = np.zeros((count, 6), np.float32)[:, ::2]
        assert dfd.pose(np.zeros((count, 3)), strided, np.tile(np.eye(3, 4), (3, 1, 1))).shape == (count, 3)


VERTICES, WEIGHTS, TRANSFORMS = scene(6, 2)
SHEAR = np.tile(np.eye(4), (2, 1, 1))
SHEAR[1, 3, 0] = 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"vertices": VERTICES[:, :2]}, r"`vertices` must have shape \(V, 3\), got \(6, 2\)"),
        ({"vertices": np.full((6, 3), np.nan)}, r"`vertices` must be finite, got nan at \[0, 0\]"),
        ({"vertices": np.full((6, 3), np.inf)}, r"`vertices` must be finite, got inf at \[0, 0\]"),
        ({"weights": WEIGHTS[:5]}, r"`weights` must have shape \(6, H\), got \(5, 2\)"),
        ({"weights": np.full((6, 2), np.nan)}, r"`weights` must be finite, got nan at \[0, 0\]"),
        ({"transforms": np.zeros((5, 4, 2))}, r"`transforms` must have shape \(2, 3, 4\) or .*, got \(5, 4, 2\)"),
        ({"transforms": TRANSFORMS[:1]}, r"`transforms` must have shape \(2, 3, 4\) or .*, got \(1, 3, 4\)"),
        ({"transforms": TRANSFORMS[0]}, r"`transforms` must have shape \(2, 3, 4\) or .*, got \(3, 4\)"),
        ({"transforms": np.full((2, 3, 4), np.nan)}, r"`transforms` must be finite, got nan"),
        ({"transforms": SHEAR}, r"`transforms` must have the bottom row \[0, 0, 0, 1\], got \[0.5, 0.0, 0.0, 1.0\]"),
        ({"transforms": TRANSFORMS * 1e300}, r"`transforms` move a vertex beyond"),
        ({"default": np.zeros((2, 4))}, r"`default` must have shape \(3, 4\) or \(4, 4\), got \(2, 4\)"),
        ({"default": np.zeros((4, 4))}, r"`default` must have the bottom row"),
        ({"symmetry": PLANE, "handles": [0]}, r"`handles` must name 2 handles, as many as `weights` has, got 1"),
        ({"symmetry": PLANE, "handles": [0, 6]}, r"`handles` must lie in 0 … 5, got 6"),
        ({"symmetry": PLANE, "handles": np.zeros((3, 3))}, r"`handles` must have shape \(2, 3\), got \(3, 3\)"),
        ({"normals": VERTICES[:5]}, r"`normals` must have shape \(6, 3\), got \(5, 3\)"),
        ({"normals": np.full((6, 3), np.nan)}, r"`normals` must be finite, got nan at \[0, 0\]"),
        ({"out": np.empty((6, 3))}, r"`out` must be .* float32, got \(6, 3\) and float64"),
        ({"out": np.empty((3, 6), np.float32).T}, r"`out` must be C-contiguous and writable"),
        ({"out": VERTICES}, r"`out` must not overlap `vertices`"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match="^pose: " + message):
        dfd.pose(**{"vertices": VERTICES, "weights": WEIGHTS, "transforms": TRANSFORMS, **arguments})
