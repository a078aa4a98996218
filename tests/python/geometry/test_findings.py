"""Test the sentences about unusual properties of a mesh."""

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE

from dfd.geometry.findings import findings
from dfd.mesh.mesh import Mesh

FINE = trimesh.creation.box((1, 1, 1)).subdivide().subdivide().subdivide()


def said(vertices, faces):
    return "\n".join(f"{each.what} {each.means}" for each in findings(Mesh(vertices, faces)))


def test_nothing_is_odd_about_a_good_mesh():
    assert findings(Mesh(FINE.vertices, FINE.faces)) == []


@pytest.mark.parametrize(
    ("offset", "message"),
    [
        (1.01, "2 components that no edge connects. Each touches or nearly touches another one"),
        (3.0, "2 components that no edge connects. Gaps separate 2 groups"),
    ],
)
def test_components_that_touch_and_that_do_not(offset, message):
    vertices = np.vstack([FINE.vertices, FINE.vertices + [offset, 0, 0]])
    assert message in said(vertices, np.vstack([FINE.faces, FINE.faces + len(FINE.vertices)]))


def test_defects_are_counted_in_words():
    faces = FINE.faces
    assert "The surface is open: 3 edges have one face only." in said(FINE.vertices, faces[1:])
    assert "1 face has no area." in said(FINE.vertices, np.vstack([faces, [(0, 0, 1)]]))
    assert "2 faces repeat an earlier one." in said(FINE.vertices, np.vstack([faces, faces[:2]]))
    assert "3 edges have more than two faces." in said(FINE.vertices, np.vstack([faces, faces[:1]]))
    turned = np.vstack([faces[:1, ::-1], faces[1:]])
    assert "3 edges join two faces that look to different sides." in said(FINE.vertices, turned)
    assert said(FINE.vertices, faces[:, ::-1]).startswith("The surface is closed, and its faces look inward.")
    assert "1 vertex belongs to no face." in said(np.vstack([FINE.vertices, [(0, 0, 0)]]), faces)


def test_flat_far_coarse_and_empty_shapes():
    assert "The shape is flat." in said(FINE.vertices * [1, 1, 0], FINE.faces)
    assert "far from the origin" in said(FINE.vertices + 1e6, FINE.faces)
    assert "a typical edge is 58% of the diagonal" in said(CORNERS, CUBE)
    assert said(np.ones((3, 3)), np.array([(0, 1, 2)])).startswith("1 face has no area.")
    assert "All vertices have one position." in said(np.ones((3, 3)), np.array([(0, 1, 2)]))
    assert "Faces are large" in said(CORNERS * 1e200, CUBE)
