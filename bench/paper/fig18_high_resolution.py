"""Fig. 18: large meshes, their defects and holes, and the seconds of each stage."""

from __future__ import annotations

import time

import numpy as np
import trimesh

import dfd
from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.drawing import aim, before_after
from bench.paper.measures import defects
from bench.paper.report import Page, Section, Table
from dfd.common.progress import Stages

__all__ = ["page", "subdivided"]

CASES = {  # a handle and how far it goes, as in Fig. 8, and how often every face is cut into four
    "koala": ((0.0, 0.95, 0.75), (-0.08, 0.08, 0.0), 2),
    "scorpion": ((0.0, 0.2, 1.0), (-0.05, 0.0, 0.1), 1),
    "plane_holes": ((0.0, 0.2, 0.4), (0.0, 0.0, 0.12), 1),
    "quadruped": ((0.2, 1.0, 0.9), (0.0, 0.12, 0.0), 2),
    "*": ((0.5, 1.0, 0.5), (0.0, 0.12, 0.0), 0),
}
RENDERING = ("simplify", "render")  # the stages that the paper's R counts


def page(context: Context) -> Page:
    """Each shape distilled with nothing taken from the cache."""
    drawn, rows = [], []
    for given, (place, offset, times) in context.cases(CASES, most=2 if context.quick else 4):
        shape = subdivided(given, min(times, 1) if context.quick else times)
        found = defects(shape.mesh)
        at = shape.at(place)
        handle = {"at": at, "translation": np.array(offset) * shape.mesh.diagonal}
        for preset in PRESETS:
            model = context.loaded(preset)  # loading it belongs to no shape
            stages = Stages(show=False)
            start = time.perf_counter()
            field = context.field(shape, preset, encoder=model, stages=stages)
            distilled = time.perf_counter() - start
            start = time.perf_counter()
            weights = dfd.bind(field.features(shape.mesh), [at])
            transform = np.concatenate([np.eye(3), handle["translation"][:, None]], axis=1)[None]
            dfd.pose(shape.mesh.vertices, weights, transform)
            inference = time.perf_counter() - start
            rendering = sum(stages.seconds.get(name, 0.0) for name in RENDERING)
            size = [len(shape.mesh.vertices), len(shape.mesh.faces), found.non_manifold, found.holes]
            rows.append([shape.name, named(preset), *size, rendering, distilled - rendering, inference])
            session = context.session(shape, field, preset, [handle])
            where = aim(shape.mesh, shape.mesh.vertices[[at]], session.vertices)
            told = f"#V {size[0]:,}, #F {size[1]:,}, #NM {size[2]:,}, #H {size[3]:,}"
            drawn.append((f"{shape.name}, {named(preset)}: {told}", before_after(session, where)))
    text = (
        "#NM: edges of more than two faces, and vertices around which faces form more than one fan; #H: holes. R: "
        "seconds to simplify and render; T: the rest of the distillation; I: features of all vertices, weights of one "
        "handle, and the posed shape. Faces of smaller meshes were cut into four. The paper's own seconds stand in its "
        "pictures alone; its text says that the whole takes less than a minute (NVIDIA A40) at up to 28 million faces, "
        "and that T does not depend on the resolution."
    )
    columns = ["shape", "preset", "#V", "#F", "#NM", "#H", "R s", "T s", "I s"]
    look_for = "T hardly depends on the number of faces, and on scans with holes the result is as smooth as elsewhere."
    title = "Fig. 18: high resolution"
    return Page(title, look_for, [Section("Large meshes", text, drawn, Table(columns, rows))])


def subdivided(shape: Shape, times: int) -> Shape:
    """The shape with every face cut into four, `times` times over; holes stay, looks go."""
    vertices, faces = shape.mesh.vertices, shape.mesh.faces
    for _ in range(times):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return shape if times == 0 else Shape(shape.name, dfd.Mesh(vertices, faces))
