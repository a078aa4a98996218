"""Binding beside other threads, at Ctrl-C and while the interpreter goes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from weights.made_features import unit_rows

import dfd

# Seconds of work on the slowest kernels, and little memory.
LONG = """
import signal, sys, threading, numpy as np, dfd
signal.signal(signal.SIGINT, signal.default_int_handler)
random = np.random.default_rng(0)
features = random.standard_normal((40_000, 256), dtype=np.float32)
handles = list(random.standard_normal((200, 32, 256), dtype=np.float32))
out = np.full((40_000, 200), -1, np.float32)
"""


def started(code):
    process = subprocess.Popen(
        [sys.executable, "-c", LONG + code],
        env={**os.environ, "DFD_ISA": "baseline"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal to one process")
@pytest.mark.parametrize("threads", [1, 2])
def test_control_c_ends_a_long_call(threads):
    code = f"""
dfd.set_num_threads({threads})
print("ready", flush=True)
try:
    dfd.bind(features, handles, out=out)
    print("done")
except KeyboardInterrupt:
    print("stopped before the end:", bool((out == -1).any()))
"""
    process = started(code)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert out == "stopped before the end: True\n", err
    assert process.returncode == 0, err


def test_a_daemon_thread_that_binds_lets_the_interpreter_go():
    for _ in range(3):
        process = started("""
def bind():
    while True:
        dfd.bind(features, handles[:1], out=out[:, :1].copy())
for _ in range(2):
    threading.Thread(target=bind, daemon=True).start()
print("ready", flush=True)
import time
time.sleep(0.3)
""")
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
        assert err == ""


def test_handles_that_another_thread_changes_are_read_once():
    features = unit_rows(2000, 16)
    handles = np.arange(1000)
    stop = threading.Event()

    def change():
        while not stop.is_set():
            handles[500] = 10**9
            handles[500] = 500

    thread = threading.Thread(target=change)
    thread.start()
    try:
        for _ in range(30):
            try:
                weights = dfd.bind(features, handles)
            except ValueError as error:
                assert "must lie in 0 … 1999, got 1000000000" in str(error)  # noqa: PT017
            else:
                assert weights[500, 500] == 1
    finally:
        stop.set()
        thread.join()
