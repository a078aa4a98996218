"""Test that Ctrl-C interrupts `bind`."""

import os
import signal
import subprocess
import sys
import time

import pytest

# A bind with the slowest kernels takes seconds, and little memory.
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
