"""`python -m bench.quality VERB`: measure weights with the module that VERB names.

The table has a row for each category of shapes, with the means over its shapes. The last row has means over categories.
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

import dfd
from bench.quality import alike, anatomy, labelled, landmarks, mirrored, people
from bench.tables import to_csv, to_markdown, write_text
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "quality"
MEASURES: dict[str, tuple[Any, Any]] = {  # for each verb: the module, and the function that yields its shapes
    "labelled": (labelled, labelled.labelled_shapes),
    "anatomy": (anatomy, anatomy.rigged_shapes),
    "mirrored": (mirrored, mirrored.paired_shapes),
    "landmarks": (landmarks, landmarks.landmark_shapes),
    "people": (people, people.people_shapes),
    "alike": (alike, alike.alike_shapes),
}
Row = tuple[str, str, Mapping[str, float]]  # category and name of a shape, and its numbers by the name of the measure


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure all shapes of a folder. After every shape, write the tables again."""
    parser = argparse.ArgumentParser("python -m bench.quality", description=__doc__)
    parser.add_argument("verb", choices=list(MEASURES), help="the reference with which the weights are compared")
    parser.add_argument("folder", type=Path, nargs="?", help="folder of shapes; without it, labelled uses samples")
    parser.add_argument("--quick", action="store_true", help="measure one labelled shape of each category, or two rigs")
    parser.add_argument("--encoder", default=DEFAULT_ENCODER, help="image encoder: a name or a folder (%(default)s)")
    parser.add_argument(
        "--preset", default="default", choices=get_args(Preset), help="preset of the fields and sessions"
    )
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder to write to (%(default)s)")
    given = parser.parse_args(arguments)
    if given.verb != "labelled" and given.folder is None:
        parser.error(f"{given.verb} needs a folder of skinned GLB files")
    if given.encoder == DEFAULT_ENCODER:
        os.environ["HF_HUB_OFFLINE"] = "1"
    module, read = MEASURES[given.verb]
    own = "" if given.encoder == DEFAULT_ENCODER else f"_{Path(given.encoder).name}"
    path = given.output / f"{given.verb}{own}{'' if given.preset == 'default' else f'_{given.preset}'}"
    rows: list[Row] = []
    for shape in read(given.folder, quick=given.quick):
        print(shape.name, file=sys.stderr)
        field = dfd.distill(shape.mesh, given.encoder, preset=given.preset, progress=False)
        # Each rig is its own category.
        rows.append((getattr(shape, "category", shape.name), shape.name, module.judged(shape, field)))
        write(path, (module.__doc__ or "").splitlines()[0], rows, module.LEGEND)
    print(f"{path}.md")


def write(path: Path, title: str, rows: Sequence[Row], legend: Mapping[str, str]) -> None:
    """Write PATH.csv with a row for each shape, and PATH.md with a row for each category."""
    names = list(rows[0][2])
    cells = [[category, name, *numbers.values()] for category, name, numbers in rows]
    table = [
        [category, *_means([list(row[2].values()) for row in rows if row[0] == category])]
        for category in dict.fromkeys(row[0] for row in rows)
    ]
    means = ["mean", *_means([row[1:] for row in table])]
    blocks = [f"# {title}", f"{len(rows)} shapes.", to_markdown(["category", *names], [*table, means], ".3f")]
    blocks.append("\n".join(f"- **{word}**: {meaning}." for word, meaning in legend.items()))
    write_text(path.with_name(f"{path.name}.csv"), to_csv(["category", "shape", *names], cells))
    write_text(path.with_name(f"{path.name}.md"), "\n\n".join(blocks) + "\n")


def _means(rows: Sequence[Sequence[float | None]]) -> list[float | None]:
    """Return the mean of the numbers in each column, or None for a column without numbers."""
    return np.ma.masked_invalid(np.array(rows, float)).mean(axis=0).tolist()


if __name__ == "__main__":
    main()
