"""Background work for one shape: find, open or distill its field, then compute the data for the first handle."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from dfd.app.options import SessionOptions, Source
from dfd.app.session.distill_process import DistillProcess

if TYPE_CHECKING:
    from dfd.common.preset import Preset
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.segmentation.parts import Parts
    from dfd.symmetry.plane import SymmetryPlane

# Seconds of each stage of a distillation with the default settings on two cores, in order.
USUAL_SECONDS = {"read": 0.5, "load": 5.0, "simplify": 1.0, "render": 1.0, "encode": 8.0, "smooth": 1.5, "fit": 4.0}


@dataclass
class SharedShape:
    """Data that all sessions of one shape and field share; None until the first session has computed it."""

    making: threading.Lock = field(default_factory=threading.Lock)
    features: Any = None
    planes: dict[Preset, list[SymmetryPlane]] = field(default_factory=dict)
    parts: Parts | None = None


_SHARED: WeakValueDictionary[str, SharedShape] = WeakValueDictionary()  # by the content of mesh and field
_DISTILLING = threading.Lock()  # held by the running distillation, because two would each take twice as long


class Preparation:
    """The background work for one shape, which is read from `source`; fields are saved in `folder`.

    Progress and results are passed to the methods `field_…` of `session`; `post` calls them on the session's thread.
    """

    def __init__(
        self,
        mesh: Mesh,
        source: Source,
        options: SessionOptions,
        folder: Path,
        session: Any,
        post: Callable[[Callable[[], None]], None],
    ) -> None:
        self._mesh, self._source, self._options, self._folder = mesh, source, options, folder
        self._session, self._post = session, post
        self._dropped = False
        self._stopped = threading.Event()
        self._process: DistillProcess | None = None
        self._shared: SharedShape | None = None

    def find(self) -> None:
        """Search the cache for a field of the shape, and open it; distill it if there is none."""
        self._start("prepare", self._find)

    def open(self, path: Path, origin: str) -> None:
        """Open the field in a file."""
        self._start("prepare", lambda: self._prepare(path, origin))

    def distill(self) -> None:
        """Distill the field in another process."""
        self._stopped.clear()
        self._start("distill", self._distill)

    def cancel(self) -> None:
        """Stop a distillation."""
        self._stopped.set()
        if self._process is not None:
            self._process.stop()

    def drop(self) -> None:
        """Stop a distillation, and report nothing more."""
        self._dropped = True
        self.cancel()

    def _start(self, task: str, work: Callable[[], None]) -> None:
        def run() -> None:
            try:
                work()
            except Exception as error:
                self._tell("field_ended", task, error)

        threading.Thread(target=run, name=f"dfd-{task}", daemon=True).start()

    def _tell(self, name: str, *arguments: Any) -> None:
        def call() -> None:
            if not self._dropped:
                getattr(self._session, name)(*arguments)

        self._post(call)

    def _find(self) -> None:
        from dfd.distillation.distill import find_distilled
        from dfd.distillation.settings import DistillSettings

        given = self._options.distill_arguments()
        encoder = given.pop("encoder")
        use_cache, device = given.pop("cache", True), given.pop("device", None)
        settings, device_name = DistillSettings(**given), None if device is None else str(device)
        found = find_distilled(self._mesh, encoder, settings, device=device_name) if use_cache else None
        if found is None:
            self._distill()
            return
        path = self._folder / "cached.field.safetensors"
        found.save(path)
        self._prepare(path, "cache")

    def _distill(self) -> None:
        path, begun = self._folder / "distilled.field.safetensors", time.monotonic()

        def tell(stage: str, done: int, total: int | None) -> None:
            left = seconds_left(stage, done, total, time.monotonic() - begun)
            self._tell("field_progress", "distill", stage, done, total, left)

        try:
            while not _DISTILLING.acquire(timeout=0.1):
                tell("wait", 0, None)
                begun = time.monotonic()
                if self._stopped.is_set():
                    raise ValueError("It was stopped while it waited")
            try:
                self._process = DistillProcess(self._source, self._options, path)
                if self._stopped.is_set():
                    self._process.stop()
                self._process.run(tell)
            finally:
                _DISTILLING.release()
                self._process = None
        except ValueError:
            if not self._stopped.is_set():
                raise
            self._tell("field_ended", "distill", None)
        else:
            self._prepare(path, "distilled")

    def _prepare(self, path: Path, origin: str) -> None:
        self._tell("field_progress", "prepare", "load", 0, None, None)
        from dfd.editing.deformer import Deformer
        from dfd.editing.influence.handle_features import HandleFeatures
        from dfd.editing.presets import PRESETS
        from dfd.field.cache_key import hash_arrays
        from dfd.field.compatibility import check_compatible
        from dfd.field.field import Field
        from dfd.symmetry.search import symmetry_planes

        mesh = self._mesh
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            field = Field.load(path, mesh=mesh)
            check_compatible(field, mesh)
        messages = [str(each.message) for each in caught if issubclass(each.category, UserWarning)]
        assert field.source is not None
        key = f"{hash_arrays(mesh.vertices, mesh.faces)} {field.source.sha256}"
        self._shared = shared = _SHARED.setdefault(key, SharedShape())
        with shared.making:
            if shared.features is None:
                rows = HandleFeatures(mesh, field)
                rows.prepare(self._counted(field))
                shared.features = rows.features
            deformer = Deformer(mesh, field, preset=self._options.preset, features=shared.features)
            self._tell("field_ready", deformer, path, origin, messages)
            if shared.parts is None:
                for preset, defaults in PRESETS.items():
                    shared.planes[preset] = symmetry_planes(
                        field, mesh, candidates=defaults.candidates, threshold=defaults.threshold
                    )
            shared.parts = deformer.bound.grips.prepare(shared.planes["default"], shared.parts)
        self._tell("field_prepared", shared.planes)

    def _counted(self, field: Field) -> Callable[[int], None]:
        """Return a function that reports the progress of features; it is called with numbers of further vertices."""
        count, done, reported = len(self._mesh.vertices), 0, 0.0

        def advance(rows: int) -> None:
            nonlocal done, reported
            done += rows
            if time.monotonic() - reported > 0.1:
                reported = time.monotonic()
                self._tell("field_progress", "prepare", "features", done, count, None)

        return advance


def seconds_left(stage: str, done: int, total: int | None, elapsed: float) -> float | None:
    """Estimate the seconds left of a distillation with `done` of `total` items of `stage` done; None if unknown."""
    if stage not in USUAL_SECONDS:
        return None
    names = list(USUAL_SECONDS)
    spent = sum(USUAL_SECONDS[name] for name in names[: names.index(stage)])
    spent += USUAL_SECONDS[stage] * done / total if total else 0.0
    left = sum(USUAL_SECONDS.values()) - spent
    return left * elapsed / spent if spent > 0.0 else left
