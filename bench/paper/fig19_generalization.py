"""Fig. 19: one field on other tessellations of its shape, and on another shape of the class."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import dfd
from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.drawing import aim, before_after
from bench.paper.fig18_high_resolution import subdivided
from bench.paper.measures import vertex_shares
from bench.paper.report import Page, Section, Table
from dfd.geometry.simplify import simplify
from dfd.pictures.viewpoint import azimuth_towards

__all__ = ["in_box_of", "page"]

# The shape that is distilled, where it is taken hold of (from 0 to 1 along its box), and others of its class with the
# angle, in degrees about y, that turns them to look the same way.
CASES = {
    "spot": ((0.2, 0.0, 0.2), {"quadruped": 180, "horse": 180, "alpaca": 180}),
    "fox": ((0.2, 0.0, 0.8), {"wolf": 0, "horse": 0}),
    "quadruped": ((0.2, 0.0, 0.85), {}),
    "*": ((0.0, 0.0, 1.0), {}),
}
OFFSET = np.array([0.0, -0.12, 0.0])  # of the diagonal


def page(context: Context) -> Page:
    """One pull on each mesh, all by the field of the first."""
    drawn, rows = [], []
    for shape, (place, others) in context.cases(CASES, most=1 if context.quick else 2):
        at = shape.at(place)
        azimuth = azimuth_towards(shape.mesh, shape.mesh.vertices[[at]])
        novel = {
            name: turned(context.shape(name), angle)
            for name, angle in others.items()
            if name in context.files or name == "quadruped"
        }
        copies = {f"{count:,} faces": Shape("", simplify(shape.mesh, count)) for count in (1000, 5000)}
        copies = {f"{len(shape.mesh.faces):,} faces, its own": shape, **copies}
        fine = subdivided(shape, 1)
        copies[f"{len(fine.mesh.faces):,} faces"] = fine
        for preset in PRESETS:
            field = context.field(shape, preset)
            own = context.session(shape, field, preset, [{"at": at}]).weights[:, 0]
            weights_row, moved_row = [], []
            for name, each in {**copies, **novel}.items():
                mesh = each.mesh
                points = mesh.vertices if name in copies else in_box_of(mesh, shape.mesh)
                features = field(points)
                wanted = field(shape.mesh.vertices[[at]])
                handle = {
                    "at": int(np.linalg.norm(features - wanted, axis=1).argmin()),
                    "translation": OFFSET * mesh.diagonal,
                }
                session = context.session(each, field, preset, [handle], features=features)
                where = aim(mesh, (), session.vertices, azimuth=azimuth)
                (heat, _), (moved, _) = before_after(session, where)
                weights_row.append((heat, name))
                moved_row.append((moved, name))
                weights = session.weights[:, 0]
                off = np.abs(weights[nearest(mesh, shape.mesh)] - own)
                follows = float(vertex_shares(mesh)[weights > 0.5].sum())
                own_off = float(off.mean()) if name in copies else None
                rows.append([shape.name, named(preset), name, len(mesh.faces), 100 * follows, own_off])
            drawn.append((f"field of {shape.name}, {named(preset)}: weights", weights_row))
            drawn.append(("moved", moved_row))
    text = (
        "Other tessellations ask the field at their own vertices. Another shape of the class is turned to look the "
        "same way and scaled to the box; its handle is the vertex whose feature is nearest to that of the handle. In "
        "the table: how much of the surface has a weight above 0.5, and the mean difference between the weight at each "
        "vertex of the shape's own mesh and that at the nearest vertex of the other."
    )
    columns = ["field of", "preset", "mesh", "faces", "follows, % of the area", "mean difference"]
    look_for = "All legs come along with the one that is pulled, on every tessellation and on the other animals too."
    return Page("Fig. 19: weight generalization", look_for, [Section("One field", text, drawn, Table(columns, rows))])


def turned(shape: Shape, degrees: float) -> Shape:
    """The shape turned about y, its long edges halved, without its looks."""
    angle = np.radians(degrees)
    rotation = np.array([(np.cos(angle), 0, np.sin(angle)), (0, 1, 0), (-np.sin(angle), 0, np.cos(angle))])
    refined = shape.refined().mesh
    return Shape(shape.name, dfd.Mesh(refined.vertices @ rotation.T, refined.faces))


def nearest(mesh: dfd.Mesh, other: dfd.Mesh) -> NDArray[np.int64]:
    """The vertex of `mesh` nearest to each vertex (V,) of `other`."""
    found: NDArray[np.int64] = cKDTree(mesh.vertices).query(other.vertices)[1]
    return found


def in_box_of(mesh: dfd.Mesh, other: dfd.Mesh) -> NDArray[np.float64]:
    """The vertices of `mesh` scaled, side by side, into the box of `other`."""
    low, high = mesh.bounds
    begin, end = other.bounds
    points: NDArray[np.float64] = begin + (mesh.vertices - low) / np.maximum(high - low, 1e-12) * (end - begin)
    return points
