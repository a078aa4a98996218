"""A replacement of Ray that runs tasks in this process, one after another, and simulates failures."""

from functools import partial
from types import SimpleNamespace

from dfd.batch.steps import process


class RayError(Exception):
    """The base class of Ray's errors."""


class RayTaskError(RayError):
    """An error of the task itself."""

    def __init__(self, cause: BaseException) -> None:
        self.cause = cause


class OutOfMemoryError(RayError):
    """Ray ended the process because memory ran out."""


class FakeRay:
    """Runs tasks in this process, in order; `ends` maps a shape's name to its error, or to "hangs"."""

    exceptions = SimpleNamespace(RayError=RayError, RayTaskError=RayTaskError, OutOfMemoryError=OutOfMemoryError)

    def __init__(self, **ends: BaseException | str) -> None:
        self.ends, self.started, self.options, self.cancelled = ends, [], {}, []

    def init(self, **options):
        self.options |= options

    def cluster_resources(self):
        return {"CPU": 2.0, "memory": 4.0 * 2**30}

    def remote(self, **options):
        self.options |= options
        return lambda task: SimpleNamespace(remote=lambda *arguments: partial(process, *arguments[:3]))

    def wait(self, references, timeout):
        ready = [each for each in references if self.ends.get(each.args[1].name) != "hangs" or each in self.cancelled]
        return ready[:1], []

    def get(self, reference):
        name = reference.args[1].name
        self.started.append(name)
        if name in self.ends:
            raise self.ends[name] if reference not in self.cancelled else RayError("cancelled")
        try:
            return reference()
        except Exception as error:
            raise RayTaskError(error) from None

    def cancel(self, reference, force):
        self.cancelled.append(reference)

    def shutdown(self):
        self.options["shut"] = True
