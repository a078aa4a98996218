"""The result of one shape: the small JSON file that is written last into its folder."""

from __future__ import annotations

import platform
import re
import secrets
import socket
from datetime import datetime, timezone
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from dfd.batch.inputs import is_remote

Cause = Literal["input", "memory", "timeout", "crash", "error"]
CAUSES: dict[str, str] = {
    "input": "bad input",
    "memory": "out of memory",
    "timeout": "out of time",
    "crash": "crash",
    "error": "error of dfd",
}
FAILED_EXPORT = "_failed"  # ends the name of the figure that says why an export could not be written
Figure = bool | int | float | str | None
TOO_MUCH = "Memory"  # begins the exit note of a process that exceeded its memory


class Record(BaseModel):
    """The result of one shape."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["dfd-record"] = "dfd-record"
    version: Literal[1] = 1
    name: str
    path: str
    # status, cause, message: "done", or "failed" with why: the input was refused, memory or time ran out, its process
    # died, or an error of dfd itself
    status: Literal["done", "failed"]
    cause: Cause | None = None
    message: str | None = None
    # sha256, size: of its file, where that could be read; bytes
    sha256: str | None = None
    size: int | None = None
    modified: int | None = None  # nanoseconds, of a file here
    settings: str  # the hash of the batch's settings
    attempts: int  # how many times it was begun
    # seconds, timings: all of it, and each step
    seconds: float
    timings: dict[str, float] = Field(default_factory=dict)
    memory: int | None = None  # the most that its process had, bytes
    # what steps found, by name: the further columns of the table
    figures: dict[str, Figure] = Field(default_factory=dict)
    files: list[str] = Field(default_factory=list)  # what is in its folder besides this
    warnings: list[str] = Field(default_factory=list)
    versions: dict[str, str] = Field(default_factory=dict)
    host: str = Field(default_factory=socket.gethostname)
    finished: str = ""


class Limits(BaseModel):
    """What one task may use: threads, seconds and bytes; None is without limit."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    threads: int = 1
    timeout: float | None = None
    memory: int | None = None
    gpus: float = 0.0


class Job(BaseModel):
    """One attempt at one shape, as it is sent to a worker."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    root: str
    name: str
    path: str
    field: str | None
    attempt: int
    token: str  # of the attempt's own folder
    limits: Limits

    def record(self, settings: str, *, seconds: float, cause: Cause | None = None, **found: Any) -> Record:
        """The record of the shape, under settings with that hash."""
        return Record(
            name=self.name,
            path=self.path,
            status="done" if cause is None else "failed",
            cause=cause,
            settings=settings,
            attempts=self.attempt,
            seconds=seconds,
            versions=versions(),
            finished=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            **found,
        )


class WorkerDied(BaseModel):
    """A worker ended before its job did."""

    how: str


class Stopped(BaseModel):
    """The batch cannot continue with any shape: its folder cannot be written."""

    why: str


@cache
def versions() -> dict[str, str]:
    """The versions of the software that wrote a record."""
    found = {"python": platform.python_version()}
    for package in ("dfd", "numpy", "torch", "transformers", "trimesh"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "unknown"
    return found


def modified(path: str) -> int | None:
    """When a file here was changed, nanoseconds; None where that is not known."""
    if is_remote(path):
        return None
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return None


def new_token() -> str:
    """A name for an attempt that no other one has."""
    return secrets.token_hex(8)


def failures(cause: str, count: int) -> str:
    """How many shapes failed of a cause, in words."""
    return f"{count:,} failed: {CAUSES[cause]}"


def exit_reason(words: str, limits: Limits) -> tuple[Cause, str] | None:
    """The cause of a worker's end and a message, from its exit note; None without one."""
    if words.startswith(TOO_MUCH):
        had = int(words.split()[1])
        return "memory", f"needed more than the {(limits.memory or 0) / 2**30:.2g} GiB of a task, {had / 2**30:.2g} GiB"
    if words.startswith("Timeout"):
        calls = re.findall(r'File "[^"]*?((?:dfd/)?[^"/]+/[^"/]+)", line (\d+) in (\S+)', words.rpartition("Thread")[2])
        where = next((each for each in calls if each[0].startswith("dfd/")), calls[0] if calls else None)
        at = f", in {where[2]} ({where[0]}, line {where[1]})" if where else ""
        return "timeout", f"took longer than {limits.timeout:g} s{at}"
    return None
