"""Tests that unusual or wrong values of public arguments raise a ValueError that names the argument."""

import numpy as np
import pytest
import torch
from made_field import made_field
from mesh_files import CORNERS, CUBE

import dfd
from dfd.editing.controls import Controls

FEATURES = np.eye(4, dtype=np.float32)
VERTICES = np.arange(12.0).reshape(4, 3)
WEIGHTS = dfd.bind(FEATURES, [0])
MOVE = np.eye(3, 4)[None]

FUNCTIONS = {
    "features": lambda value: dfd.bind(value((4, 4)), [0]),
    "handles": lambda value: dfd.bind(FEATURES, value((2, 4))),
    "fixed": lambda value: dfd.bind(FEATURES, [0], fixed=value((2, 4))),
    "geodesic": lambda value: dfd.bind(FEATURES, [0], geodesic=value((1, 4))),
    "reach": lambda value: dfd.bind(FEATURES, [0], reach=value((1,))),
    "vertices": lambda value: dfd.pose(value((4, 3)), WEIGHTS, MOVE),
    "weights": lambda value: dfd.pose(VERTICES, value((4, 1)), MOVE),
    "transforms": lambda value: dfd.pose(VERTICES, WEIGHTS, value((1, 3, 4))),
    "default": lambda value: dfd.pose(VERTICES, WEIGHTS, MOVE, default=value((3, 4))),
    "out": lambda value: dfd.pose(VERTICES, WEIGHTS, MOVE, out=value((4, 3))),
    "offset": lambda value: dfd.SymmetryPlane((1, 0, 0), value(())),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_tensors_without_numbers_are_refused(name):
    with pytest.raises(ValueError, match=f"`{name}` must be on the CPU, got a tensor on meta"):
        FUNCTIONS[name](lambda shape: torch.empty(shape, device="meta", dtype=torch.float64))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_masked_arrays_are_refused(name):
    with pytest.raises(ValueError, match=f"`{name}` must not be a masked array"):
        FUNCTIONS[name](lambda shape: np.ma.masked_array(np.ones(shape), mask=np.ones(shape, bool)))


def test_tensors_with_the_negative_bit_have_their_values():
    negative = torch.full((4, 3), 1 + 2j, dtype=torch.complex128).conj().imag
    assert negative.is_neg()
    np.testing.assert_array_equal(dfd.pose(negative, WEIGHTS, MOVE), np.full((4, 3), -2.0))
    field = made_field(4, width=8, layers=1)
    np.testing.assert_allclose(field(negative), field(np.full((4, 3), -2.0)), atol=1e-5)


@pytest.mark.parametrize("name", ["locality", "reach", "radius", "mask_feather"])
def test_numbers_too_large_for_the_kernels_are_refused_early(name):
    with pytest.raises(ValueError, match=f"`{name}` must be at most 1e\\+38, got 1e\\+39"):
        Controls(**{name: 1e39})
    with pytest.raises(ValueError, match=f"`{name}` must be finite, got a whole number too large"):
        Controls(**{name: 10**400})


MESH = dfd.Mesh(CORNERS, CUBE)
TAKE_FIELDS = {
    "Deformer": lambda field: dfd.Deformer(MESH, field),
    "parts": lambda field: dfd.parts(MESH, field),
    "symmetry_planes": lambda field: dfd.symmetry_planes(MESH, field),
}


@pytest.mark.parametrize("name", TAKE_FIELDS)
@pytest.mark.parametrize("given", [MESH, np.ones((8, 3)), None])
def test_values_that_are_no_field_are_refused(name, given):
    with pytest.raises(ValueError, match=rf"^{name}: `field` must be a Field, got (Mesh|ndarray|NoneType)$"):
        TAKE_FIELDS[name](given)


@pytest.mark.parametrize("take", [dfd.Geodesics, lambda mesh: dfd.VertexField(mesh, np.ones((8, 4)))])
def test_none_in_place_of_a_mesh_is_refused(take):
    with pytest.raises(ValueError, match=r"`source` must be a path, .*, got NoneType$"):
        take(None)
