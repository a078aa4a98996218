"""Background work for one shape: find, open or distill its field, then compute the data for the first handle."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from dfd.app.options import SessionOptions, Source, read_mesh
from dfd.common import check
from dfd.distillation.distill_apart import distill_apart
from dfd.posing.pose import IDENTITY

if TYPE_CHECKING:
    from dfd.common.preset import Preset
    from dfd.editing.deformer import Deformer
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.segmentation.parts import Part, Parts
    from dfd.symmetry.plane import SymmetryPlane

INTERVAL = 0.1  # shortest time in seconds between two progress messages of a stage, except the last message


@dataclass
class SharedShape:
    """Data that all sessions of one shape and field share. It is empty until the first session has computed it."""

    making: threading.Lock = field(default_factory=threading.Lock)
    features: Any = None
    planes: dict[Preset, list[SymmetryPlane]] = field(default_factory=dict)
    parts: Parts | None = None
    cut: list[Part] | None = None  # parts that cover the shape, for suggestions

    def find_planes(self, deformer: Deformer, preset: Preset) -> None:
        """Find the planes of symmetry of a preset, unless they are known."""
        from dfd.editing.presets import PRESETS
        from dfd.symmetry.search import symmetry_planes

        if preset not in self.planes:
            rules = PRESETS[preset]
            self.planes[preset] = symmetry_planes(
                deformer.mesh, deformer.field, candidates=rules.candidates, threshold=rules.threshold
            )


_SHARED: WeakValueDictionary[str, SharedShape] = WeakValueDictionary()  # by the hashes of the mesh and the field
_DISTILLING = threading.Lock()  # locked while a distillation runs: two at the same time are not faster


class Preparation:
    """The background work for the shape of a session. The shape was read from `source`, a file or a sample.

    Progress and results are passed to methods of the session, which are called on the session's thread.
    """

    def __init__(self, session: Any, mesh: Mesh, source: Source) -> None:
        self._session, self._mesh, self._source = session, mesh, source
        self._options: SessionOptions = session.options
        self._dropped = False
        self._stopped = threading.Event()
        self._process: BaseProcess | None = None
        self._shared: SharedShape | None = None
        self._last_progress: tuple[str, float] = "", 0.0  # the stage and the time of the last progress message

    def start(self, task: str, work: Callable[..., None], *arguments: Any) -> None:
        """Call `work`, a method of this class, on a new thread. If `work` fails, the session gets the exception."""
        if task == "distill":
            self._stopped.clear()

        def run() -> None:
            try:
                work(*arguments)
            except Exception as error:
                self._tell(self._session.field_ended, task, error)

        threading.Thread(target=run, name=f"dfd-{task}", daemon=True).start()

    def cancel(self) -> None:
        """Stop a distillation."""
        self._stopped.set()
        if self._process is not None:
            self._process.kill()

    def drop(self) -> None:
        """Stop a distillation. After this, no method of the session is called."""
        self._dropped = True
        self.cancel()

    def _tell(self, method: Callable[..., object], *arguments: Any) -> None:
        self._session.post(lambda: None if self._dropped else method(*arguments))

    def _progress(self, task: str, stage: str, done: int = 0, total: int | None = None) -> None:
        """Report progress when a stage starts or ends, and in between at most once per `INTERVAL`."""
        stage_before, then = self._last_progress
        now = time.monotonic()
        if stage != stage_before or done == total or now - then >= INTERVAL:
            self._last_progress = stage, now
            self._tell(self._session.tell_progress, task, stage, done / total if total else None)

    def find(self) -> None:
        """Open the shape's field: that of a sample, or from the cache. If there is none, distill a field."""
        from dfd.distillation.distill import find_distilled
        from dfd.distillation.settings import DistillSettings

        if (shipped := self._options.shipped_field(self._source)) is not None:
            self.open(shipped, "sample")
            return
        given = self._options.distill_arguments()
        encoder = given.pop("encoder")
        use_cache, device = given.pop("cache", True), given.pop("device", None)
        device, settings = None if device is None else str(device), DistillSettings(**given)
        found = find_distilled(self._mesh, encoder, settings, device=device) if use_cache else None
        if found is None:
            self._tell(self._session.tell_progress, "distill", "load")
            self.start("distill", self.distill)
            if self._options.preset == "default":
                self._begin_early()
            return
        self.open(found, "cache")

    def _begin_early(self) -> None:
        """Let the user edit with parts of the geometry, until the features are learned."""
        from dfd.editing.deformer import Deformer
        from dfd.field.geometry_field import geometry_field

        with suppress(ValueError):  # a mesh without area has no parts
            deformer = Deformer(self._mesh, geometry_field(self._mesh))
            deformer.prepare()
            deformer.bound.prepare([])
            _warm(deformer)
            self._tell(self._session.begin_early, deformer)

    def distill(self) -> None:
        """Distill the shape's field in another process, and open it."""
        path = self._session.folder / "distilled.field.safetensors"
        tell = partial(self._progress, "distill")

        def started(process: BaseProcess) -> None:
            self._process = process
            if self._stopped.is_set():
                process.kill()

        try:
            while not _DISTILLING.acquire(timeout=INTERVAL):
                tell("wait")
                if self._stopped.is_set():
                    raise ValueError("The distillation was stopped while it waited")
            try:
                distill_apart(partial(read_mesh, self._source), self._options.distill_arguments(), path, tell, started)
            finally:
                _DISTILLING.release()
                self._process = None
        except ValueError:
            if not self._stopped.is_set():
                raise
            self._tell(self._session.field_ended, "distill", None)
        else:
            self.open(path, "distilled")

    def open(self, given: Path | Field, origin: str) -> None:
        """Open a field or its file, and compute the data for the first handle."""
        self._progress("prepare", "features")
        from dfd.editing.deformer import Deformer
        from dfd.editing.weights.handle_features import HandleFeatures
        from dfd.field.cache_key import hash_arrays
        from dfd.field.compatibility import check_compatible
        from dfd.field.field import Field

        mesh, done = self._mesh, 0

        def advance(vertices: int) -> None:
            nonlocal done
            done += vertices
            self._progress("prepare", "features", done, len(mesh.vertices))

        with check.recorded_warnings() as messages:
            field = Field.load(given) if isinstance(given, Path) else given
            check_compatible(field, mesh)
        key = f"{hash_arrays(mesh.vertices, mesh.faces)} {_hash(field, mesh)}"
        self._shared = shared = _SHARED.setdefault(key, SharedShape())
        with shared.making:
            if shared.features is None:
                rows = HandleFeatures(mesh, field)
                rows.prepare(advance)
                shared.features = rows.features
            deformer = Deformer(mesh, field, preset=self._options.preset, features=shared.features)
            self._progress("prepare", "parts")
            for preset in ("default", self._options.preset):
                shared.find_planes(deformer, preset)
            shared.parts = deformer.bound.prepare(shared.planes["default"], shared.parts)
            _warm(deformer)
        self._tell(self._session.field_ready, deformer, origin, messages, dict(shared.planes))

    def find_planes(self, deformer: Deformer, preset: Preset) -> None:
        """Find the planes of symmetry of a preset, which takes seconds for a million faces."""
        assert self._shared is not None
        with self._shared.making:
            self._shared.find_planes(deformer, preset)
        self._tell(self._session.planes_found, deformer, dict(self._shared.planes))

    def cut(self, deformer: Deformer) -> None:
        """Find parts that cover the whole shape, which takes seconds."""
        shared = SharedShape() if self._shared is None else self._shared
        with shared.making:
            if shared.cut is None:
                shared.cut = deformer.bound.parts.cut()
        self._tell(self._session.suggested, deformer, shared.cut)


def _hash(field: Field, mesh: Mesh) -> str:
    """Return the hash of the field's file; of a field without a file, that of some features."""
    from dfd.field.cache_key import hash_arrays

    return hash_arrays(field(mesh.vertices[:512])) if field.source is None else field.source.sha256


def _warm(deformer: Deformer) -> None:
    """Compute the data that the first color under the pointer needs, and that later ones share."""
    from dfd.editing.weights.of_handles import probed

    probed(deformer.bound, 0, 0, IDENTITY)
