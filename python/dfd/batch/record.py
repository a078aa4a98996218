"""The record of one shape: a JSON file with the results. If the record exists, all steps for the shape have ended."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from dfd.batch.inputs import Shape
from dfd.common.files import write_file

Cause = Literal["input", "memory", "timeout", "crash", "error"]
CAUSES: dict[str, str] = {  # names of the causes in texts for users
    "input": "bad input",
    "memory": "out of memory",
    "timeout": "out of time",
    "crash": "crash",
    "error": "error of dfd",
}
FAILED_EXPORT = "_failed"  # if an export fails, `Record.figures` holds the error under a name with this ending
Figure = bool | int | float | str | None


@dataclass(frozen=True)
class Record:
    """The result of one shape."""

    name: str
    path: str
    modified: int | None  # time of the last change of the mesh file, nanoseconds
    status: Literal["done", "failed"] = "done"
    cause: Cause | None = None  # why the shape failed; None if it is done
    message: str | None = None  # the error of a failed shape; None if it is done
    seconds: float = 0.0  # duration of all steps together
    timings: dict[str, float] = field(default_factory=dict)  # duration of each step, by its name, seconds
    figures: dict[str, Figure] = field(default_factory=dict)  # numbers and other results of the steps, by name
    files: list[str] = field(default_factory=list)  # names of the files in the shape's folder, without the record
    warnings: list[str] = field(default_factory=list)

    @property
    def line(self) -> str:
        """Return the record as one line of JSON in ASCII."""
        return json.dumps(asdict(self))

    def transfers(self) -> list[str]:
        """Return for each edit a text: its confidence, or why it was refused."""
        names = [name.removesuffix("_confidence") for name in self.figures if name.endswith("_confidence")]
        told = {name: f"confidence {self.figures[f'{name}_confidence']:.2f}" for name in names}
        return [f"{name}: {self.figures.get(f'{name}_refused') or told[name]}" for name in names]


def shape_folder(root: Path, name: str) -> Path:
    """Return the folder of a shape in the folder of its batch."""
    return root / "shapes" / name


def write_record(root: Path, record: Record) -> None:
    """Write the record of a shape into its folder; raise OSError if it cannot be written."""
    folder = shape_folder(root, record.name)
    folder.mkdir(parents=True, exist_ok=True)
    write_file(folder / "record.json", record.line + "\n")


def read_record(root: Path, shape: Shape) -> Record | None:
    """Return the record of a shape; None if the record is missing or belongs to another version of the mesh file."""
    try:
        record = Record(**json.loads((shape_folder(root, shape.name) / "record.json").read_text("utf-8")))
    except (OSError, ValueError, TypeError):
        return None
    return record if (record.path, record.modified) == (shape.path, modified(shape.path)) else None


def modified(path: str) -> int | None:
    """Return the time of a file's last change, nanoseconds; None if the file cannot be read."""
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return None
