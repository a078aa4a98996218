"""What ends a task that takes too long or too much, and what it leaves behind."""

from __future__ import annotations

import subprocess
import sys

import pytest

from dfd.batch.record import Limits, exit_reason
from dfd.batch.worker import guarded

CHILD = """
import sys, time
from pathlib import Path
from dfd.batch.worker import guarded
from dfd.batch.record import Limits
limits = Limits.model_validate_json(sys.argv[2])
with guarded(Path(sys.argv[1]), limits):
    {work}
print("went on")
"""


def exit_note(tmp_path, limits: Limits, work: str) -> tuple[str, subprocess.CompletedProcess[str]]:
    words = tmp_path / "words"
    command = [sys.executable, "-c", CHILD.format(work=work), str(words), limits.model_dump_json()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    return words.read_text(), done


def test_time_is_up_even_inside_an_extension(tmp_path):
    """A product that takes minutes never lets go of the interpreter's lock."""
    limits = Limits(timeout=0.5)
    words, done = exit_note(tmp_path, limits, "sum(x * x for x in range(10**12)) if False else 10 ** (10**9)")
    assert done.returncode == 1
    assert "went on" not in done.stdout
    cause, message = exit_reason(words, limits)
    assert cause == "timeout"
    assert message.startswith("took longer than 0.5 s")


def test_memory_beyond_the_limit_ends_the_process(tmp_path):
    limits = Limits(memory=200 << 20)
    words, done = exit_note(tmp_path, limits, "hold = bytearray(600 << 20); time.sleep(60)")
    assert done.returncode == 1
    cause, message = exit_reason(words, limits)
    assert cause == "memory"
    assert message.startswith("needed more than the 0.2 GiB of a task, 0.")


def test_what_keeps_to_its_limits_goes_on(tmp_path):
    words, done = exit_note(tmp_path, Limits(timeout=60, memory=4 << 30), "pass")
    assert done.stdout == "went on\n"
    assert words == ""
    assert exit_reason(words, Limits()) is None


def test_the_most_memory_is_noted(tmp_path):
    with guarded(tmp_path / "words", Limits()) as watched:
        pass
    assert watched.highest > 10 << 20


@pytest.mark.parametrize("words", ["", "Segmentation fault"])
def test_other_words_are_no_reason(words):
    assert exit_reason(words, Limits(timeout=1)) is None
