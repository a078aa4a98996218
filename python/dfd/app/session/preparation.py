"""Background work for one shape: find, open or distill its field, then evaluate the features of all vertices."""

from __future__ import annotations

import hashlib
import threading
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.app.options import SessionOptions, Source
from dfd.app.session.distill_process import DistillProcess

if TYPE_CHECKING:
    from dfd.app.shared import SharedValues
    from dfd.common.linear_algebra import Float32
    from dfd.common.preset import Preset
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane
    from dfd.weights.compact import CompactFeatures


class Preparation:
    """The background work for one shape, which another process reads from `source`; fields are saved in `folder`.

    What the `shared` values have under `key`, that of the mesh, other sessions have as well.

    Progress and results go to the methods `field_…` of `session`, on its thread, by `post`.
    """

    def __init__(
        self,
        mesh: Mesh,
        key: str,
        shared: SharedValues,
        source: Source,
        options: SessionOptions,
        folder: Path,
        lock: Path | None,
        session: Any,
        post: Callable[[Callable[[], None]], None],
    ) -> None:
        self._mesh, self._key, self._shared = mesh, key, shared
        self._source, self._options, self._folder, self._lock = source, options, folder, lock
        self._session, self._post = session, post
        self._dropped = False
        self._process: DistillProcess | None = None

    def find_cached(self) -> None:
        """Search the cache for a field of the shape, and open it."""
        self._start("prepare", self._find)

    def open(self, path: Path, origin: str) -> None:
        """Open the field in a file."""
        self._start("prepare", lambda: self._prepare(path, origin))

    def distill(self) -> None:
        """Distill the field in a process of its own."""
        self._process = DistillProcess(self._source, self._options, self._folder, self._lock)
        self._start("distill", self._distill)

    def cancel(self) -> None:
        """Stop a distillation."""
        if self._process is not None:
            self._process.cancel()

    def drop(self) -> None:
        """Stop a distillation, and report nothing more."""
        self._dropped = True
        self.cancel()

    def _start(self, task: str, work: Callable[[], None]) -> None:
        def run() -> None:
            try:
                work()
            except MemoryError:
                self._tell("field_failed", task, "Memory ran out: take a smaller mesh, or close other programs")
            except Exception as error:
                self._tell("field_failed", task, str(error) or type(error).__name__)

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
            self._tell("field_missing")
            return
        path = self._folder / "cached.field.safetensors"
        found.save(path)
        self._prepare(path, "cache")

    def _distill(self) -> None:
        assert self._process is not None
        left = TimeLeft()

        def tell(stage: str, done: int, total: int | None) -> None:
            seconds = left.after(stage, done, total, time.monotonic())
            self._tell("field_progress", "distill", stage, done, total, seconds)

        path = self._process.run(tell)
        self._process = None
        if path is None:
            self._tell("field_cancelled")
        else:
            self._prepare(path, "distilled")

    def _prepare(self, path: Path, origin: str) -> None:
        self._tell("field_progress", "prepare", "load", 0, None, None)
        from dfd.editing.deformer import Deformer
        from dfd.editing.influence.handle_features import HandleFeatures
        from dfd.editing.presets import PRESETS
        from dfd.field.compatibility import check_compatible
        from dfd.field.field import Field
        from dfd.symmetry.search import symmetry_planes

        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            field = Field.load(path, mesh=self._mesh)
            check_compatible(field.center, field.scale, self._mesh)
        messages = [str(each.message) for each in caught if issubclass(each.category, UserWarning)]
        count, done, reported = len(self._mesh.vertices), 0, 0.0

        def advance(rows: int) -> None:
            nonlocal done, reported
            done += rows
            if time.monotonic() - reported > 0.1:
                reported = time.monotonic()
                self._tell("field_progress", "prepare", "features", done, count, None)

        def features() -> Float32 | CompactFeatures:
            rows = HandleFeatures(self._mesh, field)
            rows.prepare(advance)
            return rows.features

        def planes() -> dict[Preset, list[SymmetryPlane]]:
            return {
                preset: symmetry_planes(field, self._mesh, candidates=defaults.candidates, threshold=defaults.threshold)
                for preset, defaults in PRESETS.items()
            }

        key = f"{self._key} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        deformer = Deformer(
            self._mesh, field, preset=self._options.preset, features=self._shared.value(f"features {key}", features)
        )
        self._tell("field_ready", deformer, path, origin, messages)
        found = self._shared.value(f"planes {key}", planes)
        deformer.bound.prepare_instances(found["default"], partial(self._shared.value, f"instances {key}"))
        self._tell("field_planes", found)
        self._tell("field_parts")


# Seconds of each stage of a distillation with the default settings on two cores, in order. Only the proportions
# matter: the speed of this machine is estimated from the stages already finished.
USUAL_SECONDS = {"read": 0.5, "load": 5.0, "simplify": 1.0, "render": 1.0, "encode": 8.0, "smooth": 1.5, "fit": 4.0}


class TimeLeft:
    """Estimates the seconds left from the finished steps."""

    def __init__(self) -> None:
        self._stage: str | None = None
        self._start = 0.0
        self._spent: dict[str, float] = {}

    def after(self, stage: str, done: int, total: int | None, now: float) -> float | None:
        """Seconds left when `done` of `total` items of `stage` are done at time `now`; None if unknown."""
        if stage != self._stage:
            if self._stage is not None:
                self._spent[self._stage] = self._spent.get(self._stage, 0.0) + now - self._start
            self._stage, self._start = stage, now
        if stage not in USUAL_SECONDS:
            return None
        names = list(USUAL_SECONDS)
        later = sum(USUAL_SECONDS[name] for name in names[names.index(stage) + 1 :])
        known = [name for name in self._spent if name in USUAL_SECONDS]
        usual = sum(USUAL_SECONDS[name] for name in known)
        pace = sum(self._spent[name] for name in known) / usual if usual > 0 else 1.0
        stage_left = max(USUAL_SECONDS[stage] * pace - (now - self._start), 0.0)
        if total and done:
            stage_left = (now - self._start) * (total - done) / done
            # Weight this stage's measured pace by how much of it is done.
            fraction = done / total
            pace = (1 - fraction) * pace + fraction * (now - self._start) / (USUAL_SECONDS[stage] * fraction)
        return stage_left + later * pace
