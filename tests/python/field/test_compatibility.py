"""Test which meshes a session accepts for a field."""

import re
import warnings

import numpy as np
import pytest
import trimesh
from fast_simplification import simplify
from made_field import made_field
from tiny_encoder import save_tiny_encoder
from trimesh.remesh import subdivide

import dfd
from dfd.field.compatibility import check_compatible, surface_points


def moved(mesh, factor=1.0, shift=(0.0, 0.0, 0.0)):
    """Return the mesh scaled and shifted; `shift` is a multiple of its longest side."""
    return dfd.Mesh(factor * mesh.vertices + np.array(shift) * max(mesh.extents), mesh.faces)


@pytest.mark.parametrize(
    "stranger",
    [
        lambda mesh: moved(mesh, 100),
        lambda mesh: moved(mesh, 0.01),
        lambda mesh: moved(mesh, 2.54),
        lambda mesh: moved(mesh, 1 / 2.54),
        lambda mesh: moved(mesh, 1, (0, 3, 0)),
        lambda mesh: moved(mesh, 1, (-1.6, 0, 0)),
    ],
)
def test_a_field_of_another_shape_is_refused(mesh, field, features, stranger):
    other = stranger(mesh)
    message = (
        "Deformer: `field` must belong to this mesh, but it was distilled from a shape with a longest side of 0.9897 "
        f"around (0, 0.526, -0.007948), and this mesh has a longest side of {max(other.extents):.4g} around "
    )
    remedy = r"\(.*\): give the mesh the units, axes and position.*; other_shape=True accepts it anyway$"
    with pytest.raises(ValueError, match=re.escape(message) + remedy):
        dfd.Deformer(other, field)
    dfd.Deformer(other, field, other_shape=True)
    dfd.Deformer(other, field, features=features)  # with given features, the shapes are not compared


@pytest.mark.parametrize(
    "relative",
    [
        lambda mesh: dfd.samples.chair(9000).mesh,
        lambda mesh: moved(mesh, 1.2),
        lambda mesh: moved(mesh, 0.6),
        lambda mesh: moved(mesh, 1, (0.2, 0, 0)),
        lambda mesh: dfd.Mesh(mesh.vertices, mesh.faces[(mesh.vertices[mesh.faces, 1] > 0.4).all(axis=1)]),
        lambda mesh: dfd.Mesh(mesh.vertices - (mesh.vertices[:, 1:2] < 0.4) * [0, 0.2, 0], mesh.faces),
    ],
)
def test_relatives_of_the_field_s_shape_are_welcome(mesh, field, relative):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        deformer = dfd.Deformer(relative(mesh), field)
    deformer.add(0, scale=2)
    assert np.isfinite(deformer.vertices).all()


def test_a_mesh_that_reaches_far_out_of_the_field_s_box_is_told_so(mesh, field):
    standing = moved(mesh, 1, -np.array([0, mesh.bounds[0, 1], 0]) / max(mesh.extents))
    ground = made_field(16, center=standing.bounds.mean(0), scale=2 / max(standing.extents))
    dfd.Deformer(standing, ground)
    for side in (-1, 1):
        lying = dfd.Mesh(standing.vertices @ [[1, 0, 0], [0, 0, -side], [0, side, 0]], mesh.faces)
        with pytest.warns(UserWarning, match="weights beyond that shape's box are extrapolated"):
            dfd.Deformer(lying, ground)


def test_a_field_in_a_file_is_refused_for_another_shape_unless_it_is_wanted(mesh, field, tmp_path):
    field.save(tmp_path / "field.safetensors")
    other = moved(mesh, 100)
    with pytest.raises(ValueError, match=r"Field.load: `field` must belong .*; other_shape=True accepts it anyway"):
        dfd.Field.load(tmp_path / "field.safetensors", mesh=other)
    loaded = dfd.Field.load(tmp_path / "field.safetensors", mesh=other, other_shape=True)
    np.testing.assert_array_equal(loaded(mesh.vertices), field(mesh.vertices))


def test_an_edit_of_another_shape_is_taken_where_it_is_wanted(mesh, field, tmp_path):
    session = dfd.Deformer(mesh, field)
    session.add(5, translation=(0, 0.1, 0))
    session.save(tmp_path / "edit.json")
    other = moved(mesh, 3)
    with pytest.raises(ValueError, match="one of another shape; .* other_shape=True accepts it anyway"):
        dfd.Deformer.load(tmp_path / "edit.json", other, made_field(16, center=other.bounds.mean(0), scale=0.7))
    with pytest.warns(UserWarning, match="1 of the edit's vertices or sets of vertices are found by position"):
        taken = dfd.Deformer.load(tmp_path / "edit.json", other, field, other_shape=True)
    np.testing.assert_array_equal(taken.handles[0].place.position, mesh.vertices[5])


def half(mesh, axis):
    middle = mesh.vertices[mesh.faces].mean(axis=1)[:, axis]
    return dfd.Mesh(mesh.vertices, mesh.faces[middle <= np.quantile(middle, 0.55)])


@pytest.fixture(scope="module")
def known(mesh):
    """A field with stored samples of the chair's surface."""
    return made_field(16, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents)).with_surface(mesh)


@pytest.mark.parametrize(
    "copy",
    [
        lambda mesh: mesh,
        lambda mesh: dfd.samples.chair(9000).mesh,
        lambda mesh: dfd.Mesh(*subdivide(mesh.vertices, mesh.faces)),
        lambda mesh: dfd.Mesh(*simplify(mesh.vertices.astype(np.float32), mesh.faces.copy(), target_reduction=0.9)),
        lambda mesh: dfd.Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(mesh.faces.size).reshape(-1, 3)),
        lambda mesh: half(mesh, 0),
        lambda mesh: half(mesh, 2),
    ],
    ids=["itself", "remeshed", "subdivided", "decimated", "unwelded", "left half", "back half"],
)
def test_a_field_knows_other_copies_of_its_shape(mesh, known, tmp_path, copy):
    known.save(tmp_path / "field.safetensors")
    found = dfd.Field.load(tmp_path / "field.safetensors", mesh=copy(mesh))
    np.testing.assert_array_equal(found.surface, known.surface)
    dfd.Deformer(copy(mesh), found)


@pytest.mark.parametrize("sample", ["quadruped", "ball"])
def test_a_field_refuses_another_shape_of_the_same_size(mesh, known, sample):
    if sample == "ball":
        ball = trimesh.creation.icosphere(3)
        vertices, faces = ball.vertices, ball.faces
    else:
        vertices, faces = (getattr(getattr(dfd.samples, sample)(4000).mesh, name) for name in ("vertices", "faces"))
    box = np.array([vertices.min(axis=0), vertices.max(axis=0)])
    stranger = dfd.Mesh(
        (vertices - box.mean(axis=0)) / np.ptp(box, axis=0).max() * 2 / known.scale + known.center, faces
    )
    with pytest.raises(ValueError, match=r"was distilled from another shape: .*; other_shape=True accepts it anyway"):
        dfd.Deformer(stranger, known)
    dfd.Deformer(stranger, known, other_shape=True)


def test_a_small_piece_of_the_shape_is_refused(mesh, known):
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    legs = dfd.Mesh(mesh.vertices, mesh.faces[middles[:, 1] < 0.3])
    with pytest.raises(ValueError, match="0% of the mesh is far from that shape, and [6-9].% of that shape is far"):
        check_compatible(known, legs)


def test_a_distilled_field_knows_its_surface(mesh, tmp_path):
    quick = {"views": 2, "resolution": 32, "steps": 1, "cache": False, "progress": False}
    found = dfd.distill(mesh, save_tiny_encoder(tmp_path / "tiny"), **quick)
    assert found.surface.shape == (512, 3)
    np.testing.assert_array_equal(found.surface, surface_points(mesh))
