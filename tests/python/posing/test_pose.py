"""Test posed vertices: against the slow reference implementation, against exact values, and with bad input."""

import numpy as np
import pytest
import reference
import torch
from hypothesis import given
from hypothesis import strategies as st
from posing.made_motion import rotation, scene

import dfd

PLANE = dfd.SymmetryPlane((0.6, 0.0, 0.8), 0.25)
TYPES = pytest.mark.parametrize("dtype", [np.float32, np.float64])


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
        if band == 0:  # rounding can put a vertex near the plane on either side
            keep = np.abs(vertices @ np.array(plane.normal) - plane.offset) > 1e-6
            vertices, weights, posed = vertices[keep], weights[keep], posed[keep]
        wanted = reference.pose(vertices, weights, transforms, default=default, symmetry=plane, handles=places)
    assert posed.dtype == dtype
    assert posed.flags.c_contiguous
    np.testing.assert_allclose(posed, wanted, rtol=0, atol=1e-5 * max(1.0, np.abs(wanted).max(initial=0)))


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


def test_a_part_squeezed_flat_keeps_its_normals():
    vertices, _, _ = scene(40, 0)
    normals = np.tile(np.array([[0.0, 0.6, 0.8]], np.float32), (40, 1))
    posed, turned = dfd.pose(vertices, np.ones((40, 1)), np.zeros((1, 3, 4)), normals=normals)
    np.testing.assert_allclose(posed, 0, atol=1e-6)
    np.testing.assert_array_equal(turned, normals)


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
    for other in (np.asfortranarray(transforms), transforms.tolist(), transforms.astype(np.float16).astype(np.float32)):
        same = np.asarray(other, np.float64)
        np.testing.assert_array_equal(dfd.pose(vertices, weights, other), dfd.pose(vertices, weights, same.copy()))
    assert dfd.pose(np.arange(9).reshape(3, 3), np.ones((3, 1)), np.eye(3, 4)[None]).dtype == np.float64
    for dtype in (np.float16, ">f4"):
        assert dfd.pose(np.zeros((3, 3), dtype), np.ones((3, 1)), np.eye(3, 4)[None]).dtype == np.float32
    for count in (1, 3):  # strided weights are copied, even those of one vertex
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
        ({"weights": WEIGHTS[:5]}, r"`weights` must have shape \(6, H\), got \(5, 2\)"),
        ({"weights": np.full((6, 2), np.nan)}, r"`weights` must be finite, got nan at \[0, 0\]"),
        ({"transforms": np.zeros((5, 4, 2))}, r"`transforms` must have shape \(2, 3, 4\) or .*, got \(5, 4, 2\)"),
        ({"transforms": np.full((2, 3, 4), np.nan)}, r"`transforms` must be finite, got nan"),
        ({"transforms": SHEAR}, r"`transforms` must have the bottom row \[0, 0, 0, 1\], got \[0.5, 0.0, 0.0, 1.0\]"),
        ({"transforms": TRANSFORMS * 1e300}, r"`transforms` move a vertex beyond"),
        ({"default": np.zeros((2, 4))}, r"`default` must have shape \(3, 4\) or \(4, 4\), got \(2, 4\)"),
        ({"symmetry": PLANE, "handles": [0]}, r"`handles` must have 2 entries, one per column of `weights`, got 1"),
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
