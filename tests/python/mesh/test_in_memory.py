"""Tests of meshes from memory: conversion from pairs of arrays, and from and to trimesh objects."""

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE, same_shape, scene_of_three, textured_quad, write

from dfd.mesh.mesh import Mesh, load


def test_a_pair_of_arrays_is_a_mesh():
    for pair in ((CORNERS, CUBE), [CORNERS.tolist(), CUBE.tolist()]):
        mesh = load(pair)
        assert np.array_equal(mesh.vertices, CORNERS)
        assert np.array_equal(mesh.faces, CUBE)
        assert (mesh.part_names, mesh.source) == (("mesh",), None)
    with pytest.raises(ValueError, match=r"`faces` must name vertices 0 … 7, got 8"):
        load((CORNERS, CUBE + 1))


@pytest.mark.parametrize("wrong", [None, 5, (CORNERS,), {"vertices": CORNERS}, CORNERS])
def test_other_sources_are_refused(wrong):
    with pytest.raises(ValueError, match=r"load: `source` must be a path, a trimesh.Trimesh, .*, got"):
        load(wrong)


def test_a_trimesh_keeps_its_vertices_and_is_not_changed():
    split = trimesh.Trimesh(CORNERS[CUBE].reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    before = split.vertices.copy()
    mesh = load(split)
    assert np.array_equal(mesh.vertices, before)
    assert len(np.unique(mesh.faces)) == 8  # one vertex for each position
    assert np.array_equal(mesh.vertices[mesh.representative], mesh.vertices)
    assert same_shape(mesh, Mesh(CORNERS, CUBE))
    split.vertices[0] += 1
    assert np.array_equal(mesh.vertices, before)


def test_colors_are_kept_from_and_to_trimesh(tmp_path):
    cube = trimesh.Trimesh(CORNERS, CUBE, process=False)
    colors = np.tile([(255, 0, 0, 255), (0, 0, 255, 255)], (4, 1)).astype(np.uint8)
    cube.visual.vertex_colors = colors
    mesh = load(cube)
    assert np.allclose(mesh.vertex_colors() * 255, colors)
    back = mesh.to_trimesh()
    assert isinstance(back, trimesh.Trimesh)
    assert np.array_equal(back.visual.vertex_colors, colors)
    mesh.save(tmp_path / "cube.ply", mesh.vertices * 2)
    assert np.allclose(load(tmp_path / "cube.ply").vertex_colors() * 255, colors)


def test_to_trimesh_keeps_the_numbering_of_vertices_and_faces(tmp_path):
    mesh = load(write(tmp_path / "quad.glb", textured_quad(tmp_path).glb()))
    back = mesh.to_trimesh(mesh.vertices + 1)
    assert np.array_equal(back.vertices, mesh.vertices + 1)
    assert np.array_equal(back.faces, mesh.faces)
    assert back.visual.kind == "vertex"
    back.vertices[:] = 0
    assert mesh.vertices.max() == 1
    assert Mesh(CORNERS, CUBE).to_trimesh().visual.kind is None
    with pytest.raises(ValueError, match=r"Mesh.to_trimesh: `vertices` must have shape \(4, 3\)"):
        mesh.to_trimesh(CORNERS)


def test_a_scene_keeps_its_parts_and_their_transforms(tmp_path):
    scene = trimesh.Scene()
    cube = trimesh.Trimesh(CORNERS, CUBE, process=False)
    scene.add_geometry(cube, node_name="here", geom_name="cube")
    scene.add_geometry(
        cube, node_name="there", geom_name="other", transform=trimesh.transformations.translation_matrix([5, 0, 0])
    )
    mesh = load(scene)
    assert mesh.part_names == ("here", "there")
    assert mesh.bounds.tolist() == [[0, 0, 0], [6, 1, 1]]
    mesh.save(tmp_path / "scene.glb", mesh.vertices * 2)
    again = load(tmp_path / "scene.glb")
    assert again.part_names == ("here", "there")
    assert same_shape(again, Mesh(mesh.vertices * 2, mesh.faces))
    with pytest.raises(ValueError, match="load: `source` holds no faces"):
        load(trimesh.Scene())


def test_parts_have_their_faces_and_vertices(tmp_path):
    mesh = load(scene_of_three(tmp_path))
    assert repr(mesh) == "Mesh(three.glb: 20 vertices, 26 faces, 3 parts)"
    assert [part.name for part in mesh.parts] == ["square", "near", "far"]
    for part in mesh.parts:
        assert np.array_equal(part.vertices, np.unique(mesh.faces[part.faces]))
        assert np.array_equal(mesh.part_vertices(part.name), part.vertices)
        with pytest.raises(ValueError, match="read-only"):
            part.vertices[0] = 1
    assert mesh.part_vertices("paint").tolist() == mesh.part_vertices("square").tolist()  # by the name of a material
    both = np.union1d(mesh.part_vertices("near"), mesh.part_vertices("far"))
    assert np.array_equal(mesh.part_vertices("cube"), both)  # by the name of a geometry, which has two instances
    with pytest.raises(ValueError, match=r"`name` must be a part of the scene \(square, near, far\), got 'tail'"):
        mesh.part_vertices("tail")
