"""Tests of work on several threads, with and without torch, and of errors in this work."""

import threading

import pytest
import torch

import dfd
from dfd.common.devices import parallel_inference
from dfd.common.threads import beside


@pytest.mark.parametrize("threads", [1, 2])
def test_beside_raises_an_error_when_the_result_is_requested(threads):
    dfd.set_num_threads(threads)

    def work():
        raise ValueError("no ground")

    with beside(work) as result:
        pass
    with pytest.raises(ValueError, match="^no ground$"):
        result()


@pytest.fixture
def _three_threads():
    before = torch.get_num_threads()
    dfd.set_num_threads(3)
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("_three_threads")
def test_each_thread_has_one_torch_thread_and_no_gradients():
    barrier = threading.Barrier(3, timeout=10)
    seen = set()

    def work(begin, end):
        barrier.wait()  # passes only if three calls of `work` run at the same time
        seen.add((threading.get_ident(), torch.get_num_threads(), torch.is_inference_mode_enabled()))

    parallel_inference(3, 1, work)
    assert len(seen) == 3
    assert {each[1:] for each in seen} == {(1, True)}
    assert torch.get_num_threads() == 2
    assert not torch.is_inference_mode_enabled()


@pytest.mark.usefixtures("_three_threads")
def test_an_error_ends_the_work_and_is_raised():
    begun: list[int] = []

    def work(begin, end):
        begun.append(begin)
        if begin >= 10:
            raise ValueError("ten is too many")

    with pytest.raises(ValueError, match="ten is too many"):
        parallel_inference(100_000, 1, work)
    assert len(begun) < 1000
    assert torch.get_num_threads() == 2
