"""The models that what ships is learned from: under CC0 alone; docs/learned.md names their packs and makers."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.quality.parts import family_of
from dfd.encoders.known import DEFAULT_ENCODER

RESULTS = Path(__file__).resolve().parents[1] / "results" / "quality"
OF_MESHES = ("knight.glb", "kaykit_*.obj", "rigs/*.glb", "upright/*.glb")  # what is under CC0 in DFD_MESHES
OF_LESSONS = ("people/*.glb", "rigs/*.glb", "upright/*.glb")
MOST_ALIKE = 12  # of a family, so that a pack of many jars does not outweigh all else
# Words in the names of things that have no up, hang on walls, or were laid down anyhow.
WITHOUT_UP = (
    *("armor", "bone", "book_", "bouncer", "box", "cable", "can_broken", "carpet", "claymore", "club", "compass"),
    *("crystal", "cyberpunk_pack_ac", "computer", "dart", "flaregun", "glove", "katana", "lever", "match", "mirror"),
    *("package", "padlock", "pickup", "pillow_a", "scythe", "shield", "shotgun", "shoulderpads", "smoke", "snowflake"),
    *("spiketrap", "support", "torch", "towel", "trash", "_tv"),
)


def options_of(
    arguments: Sequence[str] | None, module: str, description: str | None, folder: Path
) -> argparse.Namespace:
    """Read the command line: encoder, lessons, meshes (those of DFD_MESHES), and the output, by default in `folder`."""
    parser = argparse.ArgumentParser(f"python -m bench.training.{module}", description=description)
    parser.add_argument("--encoder", default=DEFAULT_ENCODER)
    parser.add_argument("--output", type=Path, help="file to write; by default where the package looks for it")
    parser.add_argument("--lessons", type=Path, help="a folder of further CC0 models, +y up: people, rigs and upright")
    options = parser.parse_args(arguments)
    if not os.environ.get("DFD_MESHES"):
        parser.error("DFD_MESHES must name the folder of meshes to learn from")
    options.meshes = Path(os.environ["DFD_MESHES"])
    options.output = options.output or folder / f"{options.encoder}.safetensors"
    for each in (options.output.parent, RESULTS):
        each.mkdir(parents=True, exist_ok=True)
    return options


def upright_files(meshes: Path, lessons: Path | None) -> Iterator[Path]:
    """Every file to learn an up from: of DFD_MESHES all, of `lessons` the first few of each family."""
    for pattern in OF_MESHES:
        yield from sorted(meshes.glob(pattern))
    taken: Counter[str] = Counter()
    for path in sorted(path for pattern in OF_LESSONS for path in (lessons.glob(pattern) if lessons else ())):
        if taken[family_of(path.stem)] < MOST_ALIKE and not any(word in path.stem for word in WITHOUT_UP):
            taken[family_of(path.stem)] += 1
            yield path
