"""`python -m bench.batch.carried`: how often a carried handle lands on the part that it held, by how alike both look.

Shapes are the skinned models in the folder "rigs" of DFD_MESHES and of `--lessons`; a vertex's kind of part is that of
the joint that moves it the most. Handles are carried between all shapes of a family that have their kind of part. The
table is what `dfd.editing.transfer.RIGHT` was read from. The learned metric was learned from some of these shapes.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterable
from itertools import permutations
from pathlib import Path

import numpy as np
from rich.console import Console

from bench.quality import shapes
from bench.quality.fields import Lab
from bench.quality.measures import draw_handles
from bench.quality.parts import family_of
from bench.quality.report import timed
from bench.quality.shapes import Shape
from bench.tables import to_markdown
from dfd.common.linear_algebra import Bool, Float64
from dfd.editing.transfer import Carrier

CHEAP = {"views": 12, "resolution": 280}
EACH = 6  # handles in every part
EDGES = np.arange(-0.1, 1.01, 0.1)  # of the table's rows, cosines


def some_of_each_family(found: Iterable[Shape], most: int) -> dict[str, list[Shape]]:
    """The first few shapes of every family of two and more."""
    families: dict[str, list[Shape]] = {}
    for shape in found:
        alike = families.setdefault(family_of(shape.name), [])
        if len(alike) < most:
            alike.append(shape)
    return {family: alike for family, alike in families.items() if len(alike) > 1}


def carried(start: Shape, end: Shape, lab: Lab, metric: str) -> tuple[Float64, Bool]:
    """Of handles on `start` the cosines to where they land on `end`, (N,), and whether that is the same kind of part.

    Those of kinds that `end` does not have, and those that land on what belongs to no part, are left out; so are all
    where the two fields have features of different widths.
    """
    assert start.labels is not None
    assert end.labels is not None
    handles = draw_handles(start.labels, EACH)
    kinds = np.array(start.parts)[start.labels[handles]]
    shared = np.isin(kinds, end.parts)
    fields = [lab.field(shape.name, shape.mesh, metric=metric) for shape in (start, end)]
    if fields[0].dimension != fields[1].dimension:
        return np.zeros(0), np.zeros(0, bool)
    carrier = Carrier(start.mesh, fields[0], end.mesh, fields[1])
    vertices, cosines = carrier.nearest(start.mesh.vertices[handles[shared]])
    on = end.labels[vertices]
    known = on >= 0
    return cosines[known], np.array(end.parts)[on[known]] == kinds[shared][known]


def table(cosines: Float64, right: Bool) -> list[str]:
    """The lines of a table: how many of the handles in each tenth of the cosine are right."""
    row = np.digitize(cosines, EDGES)
    found = [row == each for each in range(len(EDGES) + 1)]
    rows = [
        [f"{cosines[at].min():.2f} to {cosines[at].max():.2f}", int(at.sum()), float(right[at].mean())]
        for at in found
        if at.any()
    ]
    return to_markdown(["cosine", "handles", "right"], rows, ".2f")


def main() -> None:
    """Print a table for each metric."""
    parser = argparse.ArgumentParser("python -m bench.batch.carried", description=__doc__)
    parser.add_argument("--lessons", type=Path, help="a folder with more rigs")
    parser.add_argument("--most", type=int, default=4, help="shapes of a family (%(default)s)")
    parser.add_argument("--keep", type=Path, help="a file (.npz) for the single handles")
    options = parser.parse_args()
    say: Callable[[str], None] = timed()
    os.environ["HF_HUB_OFFLINE"] = "1"
    folders = [Path(os.environ["DFD_MESHES"]), *([options.lessons] if options.lessons else [])]
    rigs = (shape for folder in folders for shape in shapes.rigs(folder, say))
    families = some_of_each_family(rigs, options.most)
    say(", ".join(f"{len(alike)} {family}" for family, alike in families.items()))
    lab = Lab(CHEAP, say)
    for shape in (shape for alike in families.values() for shape in alike):
        for metric in ("learned", "none"):  # one after the other, so that pictures are encoded once
            lab.field(shape.name, shape.mesh, metric=metric)
    kept = {}
    for metric in ("learned", "none"):
        of_family = {}
        for family, alike in families.items():
            pairs = [carried(start, end, lab, metric) for start, end in permutations(alike, 2)]
            cosines, right = (np.concatenate(each) for each in zip(*pairs, strict=True))
            of_family[family] = cosines, right
            kept |= {f"{metric} {family} cosines": cosines, f"{metric} {family} right": right}
            say(f"{metric}, {family}: {len(right)} handles, {right.mean():.2f} right")
        cosines, right = (np.concatenate(each) for each in zip(*of_family.values(), strict=True))
        Console().print("\n".join([f"\nmetric {metric}: {right.mean():.2f} right\n", *table(cosines, right)]))
    if options.keep:
        np.savez(options.keep, **kept)


if __name__ == "__main__":
    main()
