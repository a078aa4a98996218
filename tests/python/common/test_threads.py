"""Tests of threads: equal results for all thread counts, one OpenMP runtime for torch and dfd, and work after forks."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import threadpoolctl

import dfd
from dfd.common import openmp, threads

linux_only = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="torch has another runtime on this system")


def python(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **environment},
        check=False,
    )


@pytest.mark.parametrize("count", [0, -1, 1.5, 2.0, float("nan"), "two", True, 10**9, 1 << 70])
def test_thread_count_must_be_a_positive_whole_number(count):
    with pytest.raises(ValueError, match=r"^set_num_threads: `count` must be"):
        dfd.set_num_threads(count)


@pytest.mark.parametrize(("setting", "wanted"), [("3", 3), ("5,2", 5)])
def test_environment_sets_the_default(setting, wanted):
    done = python("import dfd; print(dfd.get_num_threads())", OMP_NUM_THREADS=setting)
    assert done.stdout.split() == [str(wanted)], done.stderr


def loaded_runtimes(code, **environment):
    """Return the paths of the OpenMP runtimes that a process has loaded after it has run `code`."""
    code += """
import pathlib
maps = pathlib.Path("/proc/self/maps").read_text().split()
print(*sorted({path for path in maps if "libgomp" in path or "libomp" in path}))
"""
    done = python(code, **environment)
    assert done.returncode == 0, done.stderr
    return [Path(path) for path in done.stdout.split()]


@linux_only
@pytest.mark.parametrize("order", ["torch, dfd", "dfd, torch"])
def test_one_openmp_runtime_beside_torch(order):
    code = f"""
import {order}
import numpy as np
torch.ones(300, 300) @ torch.ones(300, 300)
dfd.bind(np.ones((5000, 8), np.float32), [0])
"""
    assert loaded_runtimes(code, OMP_NUM_THREADS="2") == [openmp.find_torch_runtime()]


@linux_only
def test_torchs_runtime_is_loaded_if_the_system_has_none(tmp_path):
    (tmp_path / openmp.NAME).write_bytes(b"no library at all" * 20)  # the loader finds this file first, and fails
    code = f"import ctypes; ctypes.CDLL('{openmp.NAME}')"
    hidden = {"LD_LIBRARY_PATH": str(tmp_path), "OMP_NUM_THREADS": "2"}
    assert "OSError" in python(code, **hidden).stderr  # otherwise, the following lines test nothing
    code = "import sys, dfd; assert dfd._core.team_size(2) == 2; assert 'torch' not in sys.modules"
    assert loaded_runtimes(code, **hidden) == [openmp.find_torch_runtime()]


@linux_only
@pytest.mark.parametrize("first", ["torch", "dfd"])
def test_one_pool_of_threads_serves_torch_and_the_kernels(first):
    code = f"""
import os, torch, dfd
import dfd._core as _core
torch.set_num_threads(4)
work = {{"torch": lambda: torch.sin(torch.ones(4_000_000)), "dfd": lambda: _core.team_size(4)}}
counts = [len(os.listdir("/proc/self/task"))]
for name in ("{first}", "torch", "dfd"):
    work[name]()
    counts.append(len(os.listdir("/proc/self/task")))
print(*(count - counts[0] for count in counts))
"""
    done = python(code)
    assert done.stdout.split() == ["0", "3", "3", "3"], done.stderr


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_child_computes_the_same():
    code = """
import os, numpy as np, torch, dfd
dfd.set_num_threads(2)
features = np.random.default_rng(0).standard_normal((4000, 16)).astype(np.float32) / 8
weights = dfd.bind(features, [0, 1])
child = os.fork()
if child == 0:
    same = (dfd.bind(features, [0, 1]) == weights).all() and dfd.get_num_threads() == 1
    try:
        dfd.set_num_threads(2)
        told = False
    except RuntimeError as error:
        told = "spawn" in str(error)
    os._exit(0 if same and told else 3)
print("child", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), dfd.get_num_threads())
"""
    done = python(code, PYTHONWARNINGS="ignore")
    assert done.stdout.split() == ["child", "0", "2"], done.stderr


@linux_only
def test_torch_ends_its_work_in_a_forked_child():
    code = """
import ctypes, os, torch, dfd
torch.set_num_threads(4)

def look_up():
    torch.sin(torch.ones(4_000_000))
    rows = torch.arange(40_000).reshape(-1, 4) % 50
    return float(torch.nn.functional.embedding_bag(rows, torch.ones(50, 64), mode="sum").sum())

expected = look_up()
child = os.fork()
if child == 0:
    one = torch.get_num_threads() == ctypes.CDLL("libgomp.so.1").omp_get_max_threads() == 1
    os._exit(0 if one and look_up() == expected else 3)
print("child", os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""
    done = python(code, PYTHONWARNINGS="ignore")
    assert done.stdout.split() == ["child", "0"], done.stderr


def test_blas_has_its_former_threads_after_the_block():
    def counts():
        return [pool["num_threads"] for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas"]

    with threadpoolctl.threadpool_limits(3, user_api="blas"):
        before = counts()
        with threads.one_blas_thread():
            assert all(count == 1 for count in counts())
        assert counts() == before
