"""What sessions of one server share: made by one process, its arrays then mapped read-only by all.

A value is one file of a folder that only this user reads: its pickle, and behind it the bytes of its arrays. A process
holds a lock on the file for as long as it has one of the arrays, which ends with the process however that ends; what
nobody holds is removed when the next value is made, and the folder goes with the server's.
"""

from __future__ import annotations

import hashlib
import io
import mmap
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from dfd.app.options import Source, read_shape
from dfd.mesh.mesh import Mesh

Value = TypeVar("Value")

ALIGNMENT = 64  # bytes: each array begins at a multiple, as NumPy and the kernels have them
_LENGTH = 8  # bytes of the number that a file begins with

Stamp = tuple[str, int, int]  # a file's path, when it was written and its size


class SharedValues:
    """The values in a folder, which is made with the first; without a folder each process has its own."""

    def __init__(self, folder: Path | None) -> None:
        # Where systems have no locks that several processes hold, what nobody uses could not be told.
        self._folder = None if sys.platform == "win32" else folder

    def value(self, key: str, make: Callable[[], Value], *, known: Sequence[object] = ()) -> Value:
        """What `make` gives, by this process or by another one that asked for the same `key` before.

        While one process makes it, others wait. What it refers to among `known`, objects that every process has, stays
        outside: each gets its own in its place. Where nothing can be written, the process keeps its own value.
        """
        if self._folder is None:
            return make()
        path = self._folder / hashlib.sha256(key.encode()).hexdigest()
        try:
            self._folder.mkdir(mode=0o700, exist_ok=True)
            making = path.with_suffix(".making").open("wb")
        except OSError:
            return make()
        with making:
            _lock(making.fileno())
            with suppress(OSError):
                return _read(path, known)
            made = make()
            with suppress(OSError):
                self._remove_unused()
                _write(path, made, known)
                return _read(path, known)
        return made

    def _remove_unused(self) -> None:
        """Remove what no process has arrays of, and what one that was killed wrote half."""
        assert self._folder is not None
        for path in self._folder.iterdir():
            if path.suffix != ".making":
                holding = path.with_suffix(".making") if path.suffix == ".written" else path
                with suppress(OSError), holding.open("rb") as file:
                    _lock(file.fileno(), wait=False)
                    path.unlink()

    def shape(self, source: Source) -> tuple[Mesh, list[str], str]:
        """The mesh of `source`, the warnings of reading it, and a key of both.

        A mesh whose file, or a file that it names, was written since is read again.

        Raises ValueError, OSError as `dfd.load` does.
        """

        def make() -> tuple[Mesh, list[str], list[Stamp]]:
            mesh, warnings = read_shape(source)
            _ = mesh.normals  # every session shows them
            return mesh, warnings, _stamps([] if mesh.scene is None else sorted(mesh.scene.beside))

        key = f"shape {source.sample or _stamps([source.path] if source.path else [])}"
        mesh, warnings, beside = self.value(key, make)
        if beside != _stamps(Path(name) for name, *_ in beside):
            mesh, warnings, beside = make()
        return mesh, warnings, f"{key} {beside}"


def _stamps(paths: Iterable[Path]) -> list[Stamp]:
    """When each file was written and how large it is; nothing is known of one that is not there."""
    found = []
    for path in paths:
        with suppress(OSError):
            state = path.stat()
            found.append((str(path), state.st_mtime_ns, state.st_size))
    return found


class _Pickler(pickle.Pickler):
    """Puts numbers in the place of known objects, and makes arrays contiguous, so that none has to be copied."""

    def __init__(self, file: io.BytesIO, known: Sequence[object], keep: Callable[[pickle.PickleBuffer], None]) -> None:
        super().__init__(file, protocol=5, buffer_callback=keep)
        self._numbers = {id(each): number for number, each in enumerate(known)}

    def persistent_id(self, value: Any) -> int | None:
        return self._numbers.get(id(value))

    def reducer_override(self, value: Any) -> Any:
        if isinstance(value, np.ndarray) and not (value.flags.c_contiguous or value.flags.f_contiguous):
            return np.ascontiguousarray(value).__reduce_ex__(5)
        return NotImplemented


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, known: Sequence[object], buffers: Iterator[memoryview]) -> None:
        super().__init__(file, buffers=buffers)
        self._known = known

    def persistent_load(self, number: int) -> object:
        return self._known[number]


def _write(path: Path, value: object, known: Sequence[object]) -> None:
    """Write a value to be read by `_read`; another process finds it whole or not at all."""
    buffers: list[pickle.PickleBuffer] = []
    stream = io.BytesIO()
    _Pickler(stream, known, buffers.append).dump(value)
    arrays = [buffer.raw() for buffer in buffers]
    head = pickle.dumps((stream.getvalue(), [array.nbytes for array in arrays]))
    written = path.with_suffix(".written")
    try:
        with os.fdopen(os.open(written, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
            file.write(len(head).to_bytes(_LENGTH, "little") + head)
            for array in arrays:
                file.write(bytes(-file.tell() % ALIGNMENT))
                file.write(array)
        written.replace(path)
    finally:
        written.unlink(missing_ok=True)


def _read(path: Path, known: Sequence[object]) -> Any:
    """Map a file of `_write`: the arrays of its value are read-only, and hold the file's lock.

    Raises OSError if it is not there.
    """
    with path.open("rb") as file:
        _lock(file.fileno(), shared=True)
        data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))  # with a copy of what holds the lock
    end = _LENGTH + int.from_bytes(data[:_LENGTH], "little")
    stream, lengths = pickle.loads(data[_LENGTH:end])

    def arrays() -> Iterator[memoryview]:
        start = end
        for length in lengths:
            start += -start % ALIGNMENT
            yield data[start : start + length]
            start += length

    return _Unpickler(io.BytesIO(stream), known, arrays()).load()


def _lock(file: int, *, shared: bool = False, wait: bool = True) -> None:
    """Lock an open file until it is closed, and all that was mapped of it; OSError if it cannot be now."""
    if sys.platform != "win32":
        import fcntl

        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
