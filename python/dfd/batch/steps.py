"""The steps of processing one shape, in the folder of its attempt."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import asdict
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import fsspec
import numpy as np

import dfd
from dfd.batch.inputs import is_remote
from dfd.batch.one_edit import Original, UnlikeError, before_and_after, carry
from dfd.batch.record import FAILED_EXPORT, Figure, Job
from dfd.batch.settings import MOVED, RIGS, WEIGHTS, BatchSettings
from dfd.common.files import atomic_write
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.editing.deformer import Deformer
from dfd.export.export_rig import export_rig
from dfd.export.export_weights import export_weights
from dfd.field.field import Field
from dfd.geometry import topology
from dfd.geometry.findings import findings
from dfd.mesh.mesh import Mesh
from dfd.pictures.colors import feature_colors
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import parts_view
from dfd.segmentation.parts import cut_document
from dfd.segmentation.parts import parts as parts_of
from dfd.symmetry.search import symmetry_planes
from dfd.weights.compact import compact

FIELD, THUMBNAIL = "field.safetensors", "thumbnail.png"
PIXELS = 256  # along the side of a picture
CHUNK = 1 << 20  # bytes read at a time


class Work:
    """The processing of one shape."""

    sha256: str | None = None  # of the shape's file, once `read` is done
    size: int | None = None  # its bytes

    def __init__(self, job: Job, settings: BatchSettings, folder: Path) -> None:
        self.job, self.settings, self.folder = job, settings, folder
        self.figures: dict[str, Figure] = {}  # what was found, for the table

    def run(self, clock: Stages) -> None:
        """Read the shape and do all steps, each timed under its name."""
        with clock.stage("read"):
            self.read()
        for step in self.settings.steps:
            with clock.stage(step):
                getattr(self, step)()  # the method of its name

    def read(self) -> None:
        """Hash the file and load the mesh; remote files are downloaded first."""
        path = self.job.path
        here = Path(path)
        if is_remote(path):
            here = self.folder / f"source{Path(path).suffix.lower()}"
            with fsspec.open(path, "rb") as far, here.open("wb") as near:
                shutil.copyfileobj(far, near, CHUNK)
        digest, self.size = hashlib.sha256(), 0
        with here.open("rb") as stream:
            while data := stream.read(CHUNK):
                digest.update(data)
                self.size += len(data)
        self.sha256 = digest.hexdigest()
        self.mesh: Mesh = dfd.load(here)
        if is_remote(path):
            here.unlink()
        self.figures |= {"vertices": len(self.mesh.vertices), "faces": len(self.mesh.faces)}

    @cached_property
    def field(self) -> Field:
        """The field that the step distill made, or the one that came with the shape; ValueError if there is none."""
        if (self.folder / FIELD).exists():
            return Field.load(self.folder / FIELD)
        if self.job.field is None:
            raise ValueError("no field: the step distill makes one, or a column field of a manifest names it")
        if not is_remote(self.job.field):
            return Field.load(self.job.field, mesh=self.mesh)
        near = self.folder / "given-field.safetensors"
        with fsspec.open(self.job.field, "rb") as far:
            near.write_bytes(far.read())
        try:
            return Field.load(near)
        finally:
            near.unlink()

    @cached_property
    def session(self) -> Deformer:
        """A session of the shape, whose features are computed once."""
        session = Deformer(self.mesh, self.field)
        session.prepare()
        return session

    def inspect(self) -> None:
        """Counts and findings, as `dfd inspect` tells them."""
        counts = topology.inspect(self.mesh)
        found = findings(self.mesh, counts)
        self.write_json("inspect.json", {**asdict(counts), "findings": [asdict(each) for each in found]})
        self.figures |= {
            "components": counts.components,
            "non_manifold_edges": counts.non_manifold_edges,
            "findings": len(found),
        }

    def distill(self) -> None:
        """The field, with the encoder that this worker has loaded; a given field replaces it."""
        if self.job.field is not None:
            return
        of_encoder = DistillSettings(**self.settings.distill).of_encoder()
        encoder = loaded_encoder(self.settings.encoder, self.settings.device, **of_encoder)
        made = dfd.distill(self.mesh, encoder, progress=False, cache=False, **self.settings.distill)
        made.save(self.folder / FIELD)
        self.figures["loss"] = float(made.settings["losses"][-1])

    def features(self) -> None:
        """Features of the vertices, projected so that weights keep to 0.01: `rows` @ `basis`.T + `mean` are they."""
        small = compact(self.field.on(self.mesh))
        stored = small.stored(np.arange(len(small))) * np.float32(small.step)
        with atomic_write(self.folder / "features.npz") as temporary, temporary.open("wb") as stream:
            np.savez(stream, rows=stored.astype(np.float16), basis=small.basis, mean=small.mean)
        self.figures |= {"feature_dimensions": small.dimensions, "feature_error": float(small.error)}

    def symmetry(self) -> None:
        """Mirror planes, the best first."""
        planes = symmetry_planes(self.field, self.mesh)
        self.write_json("symmetry.json", [asdict(plane) for plane in planes])
        self.figures["symmetry_planes"] = len(planes)

    def pictures(self) -> None:
        """A thumbnail, and one in the colors of the features where there is a field."""
        save_png(self.folder / THUMBNAIL, picture(self.mesh, resolution=PIXELS))
        if self.settings.needs_field or (self.folder / FIELD).exists():
            features = self.session.features
            shown = features if isinstance(features, np.ndarray) else features.principal(3)
            save_png(self.folder / "features.png", picture(self.mesh, colors=feature_colors(shown), resolution=PIXELS))

    def edits(self) -> None:
        """Every edit that fits, with a picture of what it did; where one does not fit, the figures say so."""
        self.carried: dict[str, Deformer] = {}
        for source in self.settings.edits:
            original = loaded_original(self.job.root, source.name, source.mesh)
            name = source.name
            try:
                found = carry(
                    original, self.mesh, self.field, threshold=self.settings.threshold, features=self.session.features
                )
            except ValueError as error:  # unlike, or without a part or region of the edit
                sure = min(error.confidence.values()) if isinstance(error, UnlikeError) else 0.0
                self.figures |= {f"{name}_confidence": sure, f"{name}_refused": str(error)}
                continue
            self.figures |= {f"{name}_confidence": min(found.confidence.values()), f"{name}_refused": None}
            self.carried[name] = found.deformer
            found.deformer.save(self.folder / f"{name}.edit.json")
            if "pictures" in self.settings.steps:
                save_png(self.folder / f"{name}.png", before_and_after(found.deformer, resolution=PIXELS)[1])

    def exports(self) -> None:
        """The shape under every edit that fits, in every format that is asked for.

        Where one cannot be written, the figures say why, and all else that was made of the shape stays.
        """
        for name, deformer in self.carried.items():
            for ending in self.settings.exports:
                failed = f"{name}.{ending}{FAILED_EXPORT}"
                try:
                    WRITERS[ending](self.folder / f"{name}.{ending}", deformer)
                    self.figures[failed] = None
                except ValueError as error:
                    self.figures[failed] = f"{name}.{ending}: {' '.join(str(error).split())}"

    def parts(self) -> None:
        """The parts of the shape, the part of every vertex, and with the step pictures a drawing of them, numbered."""
        found = parts_of(self.field, self.mesh).cut()
        self.write_json("parts.json", cut_document(found))
        self.figures["parts"] = len(found)
        if "pictures" in self.settings.steps:
            save_png(self.folder / "parts.png", picture(self.mesh, **parts_view(self.mesh, found), resolution=PIXELS))

    def write_json(self, name: str, value: Any) -> None:
        """Write a file of the shape's folder."""
        with atomic_write(self.folder / name) as temporary:
            temporary.write_text(json.dumps(value, indent=2, default=_plain) + "\n", "utf-8")


@lru_cache(maxsize=1)
def loaded_encoder(name: str, device: str, **options: Any) -> Any:
    """The encoder, loaded once in a worker's life."""
    from dfd.encoders.encode import load_encoder

    return load_encoder(name, device=device, **options)


@lru_cache(maxsize=16)
def loaded_original(root: str, name: str, mesh: str) -> Original:
    """An edit of the batch, with its mesh and field."""
    path, edit, field = source_of(Path(root) / "edits", name, mesh)
    shape = dfd.load(path)
    return Original.read(edit, shape, Field.load(field, mesh=shape))


def source_of(folder: Path, name: str, mesh: str) -> tuple[Path, Path, Path]:
    """The mesh, the edit and the field of an edit in a batch's folder."""
    return folder / mesh, folder / f"{name}.edit.json", folder / f"{name}.field.safetensors"


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else str(value)


WRITERS: dict[str, Callable[[Path, Deformer], object]] = {
    **dict.fromkeys(MOVED, lambda path, deformer: deformer.mesh.save(path, deformer.vertices)),
    **dict.fromkeys(RIGS, lambda path, deformer: export_rig(deformer, path)),
    **dict.fromkeys(WEIGHTS, lambda path, deformer: export_weights(deformer, path)),
}
