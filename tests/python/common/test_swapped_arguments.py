"""A field where a mesh is meant, or a mesh, an array or nothing where a field is: refused by the argument's name."""

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE

import dfd

MESH = dfd.Mesh(CORNERS, CUBE)
TAKE_FIELDS = {
    "Deformer": lambda field: dfd.Deformer(MESH, field),
    "parts": lambda field: dfd.parts(field, MESH),
    "symmetry_planes": lambda field: dfd.symmetry_planes(field, MESH),
}


@pytest.mark.parametrize("name", TAKE_FIELDS)
@pytest.mark.parametrize("given", [MESH, np.ones((8, 3)), None])
def test_what_is_no_field_is_refused(name, given):
    with pytest.raises(ValueError, match=rf"^{name}: `field` must be a Field, got (Mesh|ndarray|NoneType)$"):
        TAKE_FIELDS[name](given)


@pytest.mark.parametrize("take", [dfd.Geodesics, lambda mesh: dfd.VertexField(mesh, np.ones((8, 4)))])
def test_what_is_no_mesh_is_refused(take):
    with pytest.raises(ValueError, match=r"`source` must be a path, .*, got NoneType$"):
        take(None)
