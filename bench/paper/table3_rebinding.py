"""Table 3: seconds to bind new handles, beside OptCtrlPoints."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import dfd
from bench.paper.context import PRESETS, Context, named
from bench.paper.peers import PEERS
from bench.paper.peers.peer import Job, run
from bench.paper.report import Page, Section, Table
from bench.quality.baselines import PeerError
from dfd.common.progress import Stages

__all__ = ["page"]

COUNTS = (1, 10, 100)
SHAPES = (
    "spot",
    "koala",
    "fox",
    "scorpion",
    "kaykit_chair_A",
    "shark",
    "boat",
    "table_roundlarge",
    "chair",
    "quadruped",
)
# The paper's Table 3, on one A40: means over 20 shapes and 1,000 random sets of each.
PAPER = [
    ["paper: DFD", None, 0.004, 0.012, 0.034],
    ["paper: biharmonic by OptCtrlPoints", None, 4.6, 11.35, 21.8],
]


def page(context: Context) -> Page:
    """Random handles on real shapes, the forward pass of the field inside each binding, preprocessing on."""
    found = context.cases({**dict.fromkeys(SHAPES), "*": None}, most=2 if context.quick else 20)
    repeats = 3 if context.quick else 50
    rows: list[list[Any]] = []
    for shape, _ in found:
        mesh = shape.mesh
        draws = np.random.default_rng(0)
        corners = np.unique(mesh.faces)
        sets = [
            [draws.choice(corners, min(count, len(corners)), replace=False) for _ in range(repeats)] for count in COUNTS
        ]
        for preset in PRESETS:
            model = context.loaded(preset)
            begin = time.perf_counter()
            field = context.field(shape, preset, encoder=model, stages=Stages(show=False))
            preprocess = time.perf_counter() - begin
            dfd.bind(field.features(mesh), sets[0][0])
            taken = []
            for some in sets:
                begin = time.perf_counter()
                for handles in some:
                    dfd.bind(field.features(mesh), handles)
                taken.append((time.perf_counter() - begin) / repeats)
            rows.append([shape.name, len(mesh.faces), named(preset), preprocess, *taken, ""])
        jobs = [Job(handles, np.arange(len(handles)), mesh.vertices[handles]) for some in sets for handles in some]
        try:
            done = [each.seconds for each in run(PEERS["OptCtrlPoints"], mesh, jobs)]
        except PeerError as error:
            rows.append([shape.name, len(mesh.faces), "OptCtrlPoints", None, None, None, None, str(error)])
        else:
            bound = np.array([each["bind"] for each in done]).reshape(len(COUNTS), repeats).mean(axis=1)
            before = done[0]["tetrahedra"] + done[0]["prepare"]
            rows.append([shape.name, len(mesh.faces), "OptCtrlPoints", before, *map(float, bound), ""])
    columns = ["method", "preprocess s", *[f"{count} handles s" for count in COUNTS]]
    done_rows = [row for row in rows if row[3] is not None]
    means = [
        [name, *np.mean([row[3:7] for row in done_rows if row[2] == name], axis=0).tolist()]
        for name in dict.fromkeys(row[2] for row in done_rows)
    ]
    text = (
        f"Means of {repeats} random sets a shape. DFD: the field's forward pass at all vertices and the weights. "
        "OptCtrlPoints, written from its paper: the tetrahedra and one factorization before, then a back substitution "
        "for each handle and one small dense system. Shapes are simplified to 6,000 faces for it and have a few "
        "thousand nodes, far fewer than those of the paper, while DFD binds every vertex: the sizes differ."
    )
    look_for = "Binding new handles needs no solve: it costs DFD about the same for 1 and for 100."
    each = ["shape", "faces", *columns, "note"]
    sections = [
        Section("Means", text, table=Table(columns, [*means, *PAPER])),
        Section("Shape by shape", table=Table(each, rows)),
    ]
    return Page("Table 3: seconds to rebind", look_for, sections)
