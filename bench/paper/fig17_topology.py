"""Fig. 17: shapes with holes, loose components and non-manifold edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

import dfd
from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim, before_after
from bench.paper.measures import defects
from bench.paper.report import Page, Section, Table
from dfd.geometry.topology import face_components, first_at_place, inspect
from dfd.pictures.picture import picture

__all__ = ["gap", "page"]

PAPER = ("the paper's example", 3804, 70, 12)
BOUNDARY, CROWDED, CLAY = (0.85, 0.15, 0.1), (0.1, 0.2, 0.9), (0.82, 0.81, 0.78)
NEAR = 0.005  # of the diagonal: vertices of two components as near as that belong together


@dataclass(frozen=True)
class Pull:
    """Where a shape is taken hold of, from 0 to 1 along the sides of its box, and what is done to it."""

    handle: tuple[float, float, float]
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the diagonal
    rotation: tuple[float, float, float] = (0, 0, 0)


CASES = {
    "truck_defects": Pull((0.4, 1.0, 0.5), (0.0, 0.1, 0.0)),
    "chair_nonmanifold": Pull((0.5, 1.0, 0.1), (0.0, 0.1, -0.05)),
    "plane_holes": Pull((0.0, 0.2, 0.4), (0.0, 0.0, 0.12)),
    "knight": Pull((0.5, 1.0, 0.5), (0.0, 0.1, 0.0)),
    "robot": Pull((0.5, 1.0, 0.5), (0.0, 0.1, 0.0)),
    "*": Pull((0.5, 1.0, 0.5), (0.0, 0.1, 0.0)),
}


def page(context: Context) -> Page:
    """Each shape's defects, and one pull by either preset."""
    drawn, rows, torn = [], [[*PAPER]], []
    for shape, case in context.cases(CASES, most=2 if context.quick else 4):
        found, counts = defects(shape.mesh), inspect(shape.mesh)
        rows.append([shape.name, counts.boundary_edges, counts.components, counts.non_manifold_edges])
        at = shape.at(case.handle)
        offset = np.array(case.offset) * shape.mesh.diagonal
        colors = np.tile(CLAY, (len(shape.mesh.vertices), 1))
        first = first_at_place(shape.mesh)
        for ends, color in ((found.boundary, BOUNDARY), (found.crowded, CROWDED)):
            colors[np.isin(first, ends)] = color
        for preset in PRESETS:
            handle = {"at": at, "translation": offset, "rotation": case.rotation}
            session = context.session(shape, context.field(shape, preset), preset, [handle])
            where = aim(shape.mesh, shape.mesh.vertices[[at]], session.vertices)
            images = [(picture(shape.mesh, colors=colors, **where), "defects"), *before_after(session, where)]
            drawn.append((f"{shape.name}, {named(preset)}", images))
            opened = gap(shape.mesh, session.vertices)
            length = float(np.linalg.norm(session.vertices - shape.mesh.vertices, axis=1).max())
            torn.append([shape.name, named(preset), None if opened is None else 100 * opened / max(length, 1e-12)])
    first_text = "Red: vertices at edges of one face; blue: at edges of more than two faces."
    columns = ["shape", "boundary edges", "components", "non-manifold edges"]
    second = (
        f"How far vertices of different components that lie within {NEAR:.1%} of the diagonal of each other part, in % "
        "of the farthest way that a vertex goes: the mean over all such pairs."
    )
    look_for = "Weights pass over holes and from component to component, so that what touches stays together."
    sections = [
        Section("Defects, weights and results", first_text, drawn, Table(columns, rows)),
        Section("Do parts that touch stay together?", second, (), Table(["shape", "preset", "gap %"], torn)),
    ]
    return Page("Fig. 17: topology robustness", look_for, sections)


def gap(mesh: dfd.Mesh, moved: np.ndarray) -> float | None:
    """The mean change of distance, mesh units, between near vertices of different components; None without any."""
    faces = first_at_place(mesh)[mesh.faces]
    component = np.full(len(mesh.vertices), -1)
    component[faces] = face_components(faces.astype(np.int32))[:, None]
    used = np.flatnonzero(component >= 0)
    pairs = used[cKDTree(mesh.vertices[used]).query_pairs(NEAR * mesh.diagonal, output_type="ndarray")]
    pairs = pairs[component[pairs[:, 0]] != component[pairs[:, 1]]]
    if len(pairs) == 0:
        return None
    between = (mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], moved[pairs[:, 0]] - moved[pairs[:, 1]])
    return float(np.linalg.norm(between[1] - between[0], axis=1).mean())
