"""A file that has its shape twice, as front and back copies, gives the encoder the pictures of one copy."""

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, write

import dfd
from dfd.mesh.mesh import load
from dfd.views.render import render

RED = "1 0 0"


def text(vertices, faces, ending):
    rows = [f"{x:g} {y:g} {z:g} {RED}" for x, y, z in vertices.tolist()]
    if ending == "obj":
        return "\n".join([*(f"v {row}" for row in rows), *("f {} {} {}".format(*face) for face in faces + 1), ""])
    head = ["COFF", f"{len(rows)} {len(faces)} 0"]
    return "\n".join([*head, *rows, *("3 {} {} {}".format(*face) for face in faces), ""])


@pytest.mark.parametrize("ending", ["obj", "off", "glb"])
@pytest.mark.parametrize("apart", [False, True])
def test_copies_change_no_picture(ending, apart, tmp_path):
    """The back copies use the vertices of the front ones, or vertices of their own."""
    pictures = []
    for twice in (False, True):
        vertices, faces = CORNERS, CUBE
        if twice:
            back = CUBE[:, ::-1]
            vertices = np.vstack([CORNERS, CORNERS]) if apart else CORNERS
            faces = np.vstack([CUBE, back + 8 if apart else back])
        content: str | bytes
        if ending == "glb":
            gltf = Gltf()
            color = gltf.accessor(np.tile([1.0, 0, 0], (len(vertices), 1)), 5126, "VEC3")
            gltf.node(mesh=gltf.mesh("cube", vertices, faces, attributes={"COLOR_0": color}))
            content = gltf.glb()
        else:
            content = text(vertices, faces, ending)
        views = render(load(write(tmp_path / f"{twice}.{ending}", content)), views=4, resolution=48)
        pictures.append((views.images, views.points))
    (once, points), (both, points_of_both) = pictures
    assert np.array_equal(once, both)
    assert np.array_equal(points, points_of_both)


def test_reversed_copies_before_some_faces_change_no_picture() -> None:
    mesh = dfd.samples.quadruped(4000).mesh
    some = mesh.faces[np.random.default_rng(0).random(len(mesh.faces)) < 1 / 3, ::-1]
    twice = dfd.Mesh(mesh.vertices, np.concatenate([some, mesh.faces]))
    once, both = (render(each, views=2, resolution=96).images.astype(int) for each in (mesh, twice))
    assert np.abs(once - both).max() <= 1  # level of brightness, by rounding
