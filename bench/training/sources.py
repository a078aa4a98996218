"""Find training models, all under CC0, and run the commands that learn. docs/learned.md lists the models."""

import argparse
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.quality.parts import family_of
from bench.tables import write_text
from dfd.common.files import atomic_write
from dfd.encoders.encode import Encoder, load_encoder
from dfd.encoders.known import DEFAULT_ENCODER

RESULTS = Path(__file__).resolve().parents[1] / "results" / "quality"
OF_MESHES = ("knight.glb", "kaykit_*.obj", "rigs/*.glb", "upright/*.glb")  # models under CC0 in DFD_MESHES
OF_LESSONS = ("people/*.glb", "rigs/*.glb", "upright/*.glb")
LARGEST_FAMILY = 12  # largest number of models of a family from `--lessons`, so that large packs do not dominate
# Models with these words in their names are skipped: they have no up, hang on walls, or lie in any direction.
WITHOUT_UP = (
    *("armor", "bone", "book_", "bouncer", "box", "cable", "can_broken", "carpet", "claymore", "club", "compass"),
    *("crystal", "cyberpunk_pack_ac", "computer", "dart", "flaregun", "glove", "katana", "lever", "match", "mirror"),
    *("package", "padlock", "pickup", "pillow_a", "scythe", "shield", "shotgun", "shoulderpads", "smoke", "snowflake"),
    *("spiketrap", "support", "torch", "towel", "trash", "_tv"),
)


def run(
    arguments: Sequence[str] | None,
    module: str,
    description: str,
    folder: Path,
    report_path: Path,
    lessons_of: Callable[[Path, Path | None, Encoder], Iterable[Any]],
    learn: Callable[[tuple[Any, ...], Encoder], Any],
    report: Callable[[tuple[Any, ...]], str],
) -> None:
    """Run a command: learn from lessons, write the result (by default to `folder`), and write a report.

    A lesson is the data of one shape. `lessons_of` takes the folders DFD_MESHES and `--lessons`, and the encoder.
    """
    parser = argparse.ArgumentParser(f"python -m {module}", description=description)
    parser.add_argument("--encoder", default=DEFAULT_ENCODER)
    parser.add_argument("--output", type=Path, help="file to write; by default, the file that dfd loads")
    parser.add_argument("--lessons", type=Path, help="folder of more CC0 models, +y up: people, rigs and upright")
    options = parser.parse_args(arguments)
    if not os.environ.get("DFD_MESHES"):
        parser.error("DFD_MESHES must name the folder of meshes to learn from")
    output, encoder = options.output or folder / f"{options.encoder}.safetensors", load_encoder(options.encoder)
    output.parent.mkdir(parents=True, exist_ok=True)
    lessons = tuple(lessons_of(Path(os.environ["DFD_MESHES"]), options.lessons, encoder))
    learn(lessons, encoder).save(output)
    write_text(report_path, report(lessons))
    print(f"{output}\n{report_path}")


def cached_arrays(path: Path, make: Callable[[], Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return the arrays in the file at `path`; if there is no file, make the arrays and write them."""
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            np.savez(stream, **make())
    with np.load(path) as arrays:
        return dict(arrays)


def upright_files(meshes: Path, lessons: Path | None) -> Iterator[Path]:
    """Yield the files from which up is learned: all of `meshes`, and up to 12 of each family in `lessons`."""
    for pattern in OF_MESHES:
        yield from sorted(meshes.glob(pattern))
    taken: Counter[str] = Counter()
    for path in sorted(path for pattern in OF_LESSONS for path in (lessons.glob(pattern) if lessons else ())):
        if taken[family_of(path.stem)] < LARGEST_FAMILY and not any(word in path.stem for word in WITHOUT_UP):
            taken[family_of(path.stem)] += 1
            yield path
