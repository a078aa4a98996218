"""Background work for one shape: find, open or distill its field, then compute the data for the first handle."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from dfd.app.options import SessionOptions, Source, read_shape, recorded_warnings
from dfd.common.progress import Stages

if TYPE_CHECKING:
    from dfd.common.preset import Preset
    from dfd.mesh.mesh import Mesh
    from dfd.segmentation.parts import Parts
    from dfd.symmetry.plane import SymmetryPlane

# The stages of a distillation in order, and each stage's usual seconds with default settings on two CPU cores.
USUAL_SECONDS = {"read": 0.5, "load": 5.0, "simplify": 1.0, "render": 1.0, "encode": 8.0, "smooth": 1.5, "fit": 4.0}
INTERVAL = 0.1  # shortest time in seconds between two progress messages of a stage, except the last message


@dataclass
class SharedShape:
    """Data that all sessions of one shape and field share. It is empty until the first session has computed it."""

    making: threading.Lock = field(default_factory=threading.Lock)
    features: Any = None
    planes: dict[Preset, list[SymmetryPlane]] = field(default_factory=dict)
    parts: Parts | None = None


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

    def _progress(self, task: str, stage: str, done: int, total: int | None, left: float | None = None) -> None:
        """Report progress when a stage starts or ends, and in between at most once per `INTERVAL`."""
        stage_before, then = self._last_progress
        now = time.monotonic()
        if stage != stage_before or done == total or now - then >= INTERVAL:
            self._last_progress = stage, now
            self._tell(self._session.tell_progress, task, stage, done, total, left)

    def find(self) -> None:
        """Open the shape's field from the cache. If the cache has none, distill a field."""
        from dfd.distillation.distill import find_distilled
        from dfd.distillation.settings import DistillSettings

        given = self._options.distill_arguments()
        encoder = given.pop("encoder")
        use_cache, device = given.pop("cache", True), given.pop("device", None)
        device, settings = None if device is None else str(device), DistillSettings(**given)
        found = find_distilled(self._mesh, encoder, settings, device=device) if use_cache else None
        if found is None:
            self.distill()
            return
        path = self._session.folder / "cached.field.safetensors"
        found.save(path)
        self.open(path, "cache")

    def distill(self) -> None:
        """Distill the shape's field in another process, and open it."""
        path, begun = self._session.folder / "distilled.field.safetensors", time.monotonic()

        def tell(stage: str, done: int, total: int | None) -> None:
            self._progress("distill", stage, done, total, seconds_left(stage, done, total, time.monotonic() - begun))

        def started(process: BaseProcess) -> None:
            self._process = process
            if self._stopped.is_set():
                process.kill()

        try:
            while not _DISTILLING.acquire(timeout=INTERVAL):
                tell("wait", 0, None)
                begun = time.monotonic()
                if self._stopped.is_set():
                    raise ValueError("The distillation was stopped while it waited")
            try:
                distill_apart(self._source, self._options.distill_arguments(), path, tell, started)
            finally:
                _DISTILLING.release()
                self._process = None
        except ValueError:
            if not self._stopped.is_set():
                raise
            self._tell(self._session.field_ended, "distill", None)
        else:
            self.open(path, "distilled")

    def open(self, path: Path, origin: str) -> None:
        """Open the field in the file `path`, and compute the data for the first handle."""
        self._progress("prepare", "load", 0, None)
        from dfd.editing.deformer import Deformer
        from dfd.editing.influence.handle_features import HandleFeatures
        from dfd.editing.presets import PRESETS
        from dfd.field.cache_key import hash_arrays
        from dfd.field.compatibility import check_compatible
        from dfd.field.field import Field
        from dfd.symmetry.search import symmetry_planes

        mesh, done = self._mesh, 0

        def advance(vertices: int) -> None:
            nonlocal done
            done += vertices
            self._progress("prepare", "features", done, len(mesh.vertices))

        with recorded_warnings() as messages:
            field = Field.load(path)
            check_compatible(field, mesh)
        assert field.source is not None
        key = f"{hash_arrays(mesh.vertices, mesh.faces)} {field.source.sha256}"
        self._shared = shared = _SHARED.setdefault(key, SharedShape())
        with shared.making:
            if shared.features is None:
                rows = HandleFeatures(mesh, field)
                rows.prepare(advance)
                shared.features = rows.features
            deformer = Deformer(mesh, field, preset=self._options.preset, features=shared.features)
            self._tell(self._session.field_ready, deformer, origin, messages)
            if shared.parts is None:
                for preset, defaults in PRESETS.items():
                    shared.planes[preset] = symmetry_planes(
                        field, mesh, candidates=defaults.candidates, threshold=defaults.threshold
                    )
            shared.parts = deformer.bound.prepare(shared.planes["default"], shared.parts)
        self._tell(self._session.field_prepared, shared.planes)


def seconds_left(stage: str, done: int, total: int | None, elapsed: float) -> float | None:
    """Estimate the remaining seconds of a distillation after `done` of `total` items of `stage`; None if unknown."""
    if stage not in USUAL_SECONDS:
        return None
    names = list(USUAL_SECONDS)
    spent = sum(USUAL_SECONDS[name] for name in names[: names.index(stage)])
    spent += USUAL_SECONDS[stage] * done / total if total else 0.0
    left = sum(USUAL_SECONDS.values()) - spent
    return left * elapsed / spent if spent > 0.0 else left


def distill_apart(
    source: Source,
    settings: dict[str, Any],
    path: Path,
    tell: Callable[[str, int, int | None], object],
    started: Callable[[BaseProcess], object],
) -> None:
    """Distill a shape in a new process, and save its field at `path`. If that process crashes, the server continues.

    `settings` are the arguments of `dfd.distill`. `tell` is called with the name of a stage, the number of finished
    items and the number of all items. `started` is called with the process, so that the caller can kill it.

    Raises ValueError if the distillation failed or was stopped.
    """
    context = get_context("spawn")
    messages, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_distill, args=(source, settings, path, theirs), daemon=True)
    process.start()
    theirs.close()  # Close our copy of the sending end. Then `recv` raises EOFError when the process ends.
    started(process)
    message: Any = None
    with messages, suppress(EOFError, OSError):
        while isinstance(message := messages.recv(), tuple):
            tell(*message)
    process.join()
    if isinstance(message, str):
        raise ValueError(message)
    if message is not True:
        code = process.exitcode or 0
        lost = ", perhaps for lack of memory" if code < 0 else f" (exit code {code})"
        raise ValueError(f"The distillation ended before it was done{lost}")


class SentStages(Stages):
    """Stages that send their progress to another process through a pipe."""

    def __init__(self, pipe: Connection) -> None:
        super().__init__(show=False)
        self._pipe = pipe

    @contextmanager
    def stage(self, name: str, total: int | None = None) -> Iterator[Any]:
        """Measure the time of the `with` block as the stage `name`, and send its progress."""
        done = 0
        self._pipe.send((name, 0, total))

        def advance(count: int = 1) -> None:
            nonlocal done
            done += count
            self._pipe.send((name, done, total))

        with super().stage(name, total):
            yield advance


def _distill(source: Source, settings: dict[str, Any], path: Path, pipe: Connection) -> None:
    """Distill a field and save it at `path`. Send tuples of progress to `pipe`, then True or an error message."""
    from dfd.distillation.distill import distill

    stages = SentStages(pipe)
    try:
        with stages.stage("read"):
            mesh, _ = read_shape(source)
        distill(mesh, **settings, progress=stages).save(path)
        pipe.send(True)
    except (OSError, ValueError, MemoryError) as error:
        pipe.send(f"Memory ran out: {error}" if isinstance(error, MemoryError) else str(error))
