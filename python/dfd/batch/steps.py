"""Run the steps of a batch for one shape, and write a folder with its results and its record."""

import errno
import json
import shutil
import time
import traceback
import warnings
from dataclasses import asdict, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import dfd
from dfd.batch.inputs import Shape
from dfd.batch.one_edit import EditSource, UnlikeError, carry, field_path
from dfd.batch.record import FAILED_EXPORT, Cause, Figure, Record, modified, shape_folder, write_record
from dfd.batch.settings import BatchSettings
from dfd.common.errors import one_line
from dfd.common.files import atomic_write, plain, write_file
from dfd.common.progress import Stages
from dfd.distillation.distill import find_distilled, store_distilled
from dfd.distillation.settings import DistillSettings
from dfd.editing.deformer import Deformer
from dfd.editing.edit import with_preset
from dfd.editing.presets import PRESETS
from dfd.export.export_rig import export_rig
from dfd.export.export_weights import export_weights
from dfd.field.field import Field
from dfd.geometry import topology
from dfd.geometry.findings import findings
from dfd.pictures.colors import feature_colors
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import parts_view, session_views
from dfd.segmentation.parts import cut_document
from dfd.segmentation.parts import parts as parts_of
from dfd.symmetry.search import symmetry_planes
from dfd.weights.compact import compact

FIELD = "field.safetensors"
PIXELS = 256  # side of a picture, pixels
loaded_original = lru_cache(maxsize=16)(EditSource.original)  # a worker process reads each edit once
FOLDER_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)  # they end the batch, because all other shapes would fail


def process(root: Path, shape: Shape, settings: BatchSettings) -> Record:
    """Run all steps for one shape, and write and return its record. If a step fails, the record gives the error.

    Raises OSError if the batch's folder `root` cannot be written.
    """
    folder = shape_folder(root, shape.name)
    shutil.rmtree(folder, ignore_errors=True)  # remove the files of an interrupted attempt
    folder.mkdir(parents=True)
    start, clock, when = time.perf_counter(), Stages(show=False), modified(shape.path)
    work = _Work(shape, settings, folder)
    cause: Cause | None = None
    message = None
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always", UserWarning)
        try:
            for step in ("read", *settings.steps):
                with clock.stage(step):
                    getattr(work, step)()  # the method with the step's name
        except MemoryError as error:
            cause, message = "memory", one_line(error) or "memory ran out"
        except (OSError, ValueError) as error:
            if isinstance(error, OSError) and error.errno in FOLDER_ERRORS:
                raise
            cause, message = "input", one_line(error)
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(frame.filename).name}, line {frame.lineno}"
            cause, message = "error", f"{type(error).__name__}: {one_line(error)} ({where})"
    if cause is not None:
        shutil.rmtree(folder)
        folder.mkdir()
    record = Record(
        shape.name,
        shape.path,
        when,
        status="done" if cause is None else "failed",
        cause=cause,
        message=message,
        seconds=time.perf_counter() - start,
        timings=clock.seconds,
        figures=work.figures,
        files=sorted(path.name for path in folder.iterdir()),
        warnings=sorted({one_line(each.message) for each in shown if issubclass(each.category, UserWarning)}),
    )
    write_record(root, record)
    return record


class _Work:
    """Run the steps, one method for each, and keep the data that several steps need."""

    def __init__(self, shape: Shape, settings: BatchSettings, folder: Path) -> None:
        self.shape, self.settings, self.folder = shape, settings, folder
        self.figures: dict[str, Figure] = {}

    def read(self) -> None:
        """Load the mesh."""
        self.mesh = dfd.load(self.shape.path)
        self.figures |= {"vertices": len(self.mesh.vertices), "faces": len(self.mesh.faces)}

    @cached_property
    def field(self) -> Field:
        """Return the distilled field, or the field that the manifest names, or the one beside the mesh file."""
        if (self.folder / FIELD).exists():
            return Field.load(self.folder / FIELD)
        path = self.shape.field or field_path(Path(self.shape.path))
        if self.shape.field is None and not Path(path).exists():
            raise ValueError(f'no field: add the step "distill", or make {path}')
        return Field.load(path, mesh=self.mesh)

    @cached_property
    def session(self) -> Deformer:
        """Return an editing session of the shape, with its features."""
        session = Deformer(self.mesh, self.field)
        session.prepare()
        return session

    def inspect(self) -> None:
        """Record counts and findings, as `dfd inspect` prints them."""
        counts = topology.inspect(self.mesh)
        found = findings(self.mesh, counts)
        self.write_json("inspect.json", {**asdict(counts), "findings": [asdict(each) for each in found]})
        self.figures |= {name: getattr(counts, name) for name in ("components", "non_manifold_edges")}
        self.figures["findings"] = len(found)

    def distill(self) -> None:
        """Distill the field, or read it from the user's cache, unless the manifest names a field."""
        if self.shape.field is not None:
            return
        name, device, settings = self.settings.encoder, self.settings.device, DistillSettings(**self.settings.distill)
        made = find_distilled(self.mesh, name, settings, device=device)
        if made is None:
            encoder = loaded_encoder(name, device, **settings.of_encoder())
            made = dfd.distill(self.mesh, encoder, progress=False, cache=False, **self.settings.distill)
            store_distilled(made, self.mesh, name, settings, device=device)
        made.save(self.folder / FIELD)
        self.figures["loss"] = float(made.settings["losses"][-1])

    def features(self) -> None:
        """Write features.npz. Its arrays give the features approximately, as `rows` @ `basis`.T + `mean`."""
        small = compact(self.field.on(self.mesh))
        stored = small.stored(np.arange(len(small))) * np.float32(small.step)
        with atomic_write(self.folder / "features.npz") as temporary, temporary.open("wb") as stream:
            np.savez(stream, rows=stored.astype(np.float16), basis=small.basis, mean=small.mean)
        self.figures |= {"feature_dimensions": small.dimensions, "feature_error": float(small.error)}

    def symmetry(self) -> None:
        """Write the mirror planes of the shape, the best first."""
        rules = PRESETS[self.settings.preset or "default"]
        planes = symmetry_planes(self.mesh, self.field, candidates=rules.candidates, threshold=rules.threshold)
        self.write_json("symmetry.json", [asdict(plane) for plane in planes])
        self.figures["symmetry_planes"] = len(planes)

    def pictures(self) -> None:
        """Write a picture of the shape. If there is a field, also write a picture whose colors show the features."""
        save_png(self.folder / "thumbnail.png", picture(self.mesh, resolution=PIXELS))
        if self.shape.field is not None or (self.folder / FIELD).exists():
            colors = feature_colors(self.session.features)
            save_png(self.folder / "features.png", picture(self.mesh, colors=colors, resolution=PIXELS))

    def edits(self) -> None:
        """Transfer every edit, and write each result. Record the confidences, and why an edit is refused."""
        threshold = self.settings.threshold
        self.carried: dict[str, Deformer] = {}
        for source in self.settings.edits:
            original, name = loaded_original(source), source.name
            if (preset := self.settings.preset) is not None:
                original = replace(original, edit=with_preset(original.edit, preset, original.mesh))
            try:
                found = carry(original, self.mesh, self.field, threshold=threshold, features=self.session.features)
            except ValueError as error:  # the shape is too different, or lacks a part or region of the edit
                sure = min(error.confidence.values()) if isinstance(error, UnlikeError) else 0.0
                self.figures |= {f"{name}_confidence": sure, f"{name}_refused": str(error)}
                continue
            self.figures |= {f"{name}_confidence": min(found.confidence.values()), f"{name}_refused": None}
            self.carried[name] = found.deformer
            found.deformer.save(self.folder / f"{name}.edit.json")
            if "pictures" in self.settings.steps:
                drawn = picture(self.mesh, **session_views(found.deformer)["after"], resolution=PIXELS)
                save_png(self.folder / f"{name}.png", drawn)

    def exports(self) -> None:
        """Write the shape, posed by each transferred edit, in every format of the settings.

        If an export raises ValueError, the record contains the error, and all other results of the shape stay.
        """
        for name, deformer in self.carried.items():
            for each in self.settings.exports:
                ending = Path(self.shape.path).suffix[1:].lower() if each == "same" else each
                failed = f"{name}.{ending}{FAILED_EXPORT}"
                try:
                    _export(self.folder / f"{name}.{ending}", deformer)
                    self.figures[failed] = None
                except ValueError as error:
                    self.figures[failed] = f"{name}.{ending}: {one_line(error)}"

    def parts(self) -> None:
        """Write the parts and the part of each vertex. With the step "pictures", also write a picture of the parts."""
        found = parts_of(self.mesh, self.field).cut()
        self.write_json("parts.json", cut_document(found))
        self.figures["parts"] = len(found)
        if "pictures" in self.settings.steps:
            save_png(self.folder / "parts.png", picture(self.mesh, **parts_view(self.mesh, found), resolution=PIXELS))

    def write_json(self, name: str, value: Any) -> None:
        """Write `value` as a JSON file into the shape's folder."""
        write_file(self.folder / name, json.dumps(value, indent=2, default=plain) + "\n")


@lru_cache(maxsize=1)
def loaded_encoder(name: str, device: str, **options: Any) -> Any:
    """Return an encoder. A worker process loads it once."""
    from dfd.encoders.encode import load_encoder

    return load_encoder(name, device=device, **options)


def _export(path: Path, deformer: Deformer) -> None:
    if path.name.endswith(".rig.glb"):
        export_rig(deformer, path)
    elif path.name.endswith((".weights.npz", ".weights.safetensors")):
        export_weights(deformer, path)
    else:
        deformer.mesh.save(path, deformer.vertices)
