"""`dfd batch --gpus`, on machines without any: what the driver asks for, and what a worker is told."""

from __future__ import annotations

import os
import signal
from types import SimpleNamespace

import pytest
import torch
from tiny_encoder import save_tiny_encoder
from typer.testing import CliRunner

import dfd
from dfd.batch import pool
from dfd.batch.on_ray import RaySlots
from dfd.batch.pool import slot_environments
from dfd.batch.record import Job, Limits, Record
from dfd.batch.settings import BatchSettings
from dfd.batch.worker import work
from dfd.cli import app


@pytest.fixture(autouse=True)
def roomy(monkeypatch):
    """A machine of 16 processors with memory enough."""
    monkeypatch.setattr(pool, "processors", lambda: 16)
    monkeypatch.setattr(pool, "available_memory", lambda: 1 << 40)


@pytest.mark.parametrize(
    ("workers", "share", "there", "devices"),
    [
        (None, 1.0, 2, ["0", "1"]),
        (None, 0.5, 2, ["0", "0", "1", "1"]),
        (None, 0.25, 1, ["0"] * 4),
        (3, 1.0, 2, ["0", "1", "0"]),  # three are asked for: two of them share
        (2, 0.0, 2, ["", ""]),
    ],
)
def test_each_slot_sees_its_own_gpu(workers, share, there, devices):
    found = slot_environments(workers, Limits(threads=2, timeout=None, memory=1 << 30, gpus=share), there)
    assert [each["CUDA_VISIBLE_DEVICES"] for each in found] == devices
    assert {each["OMP_NUM_THREADS"] for each in found} == {"2"}


def test_more_gpus_than_there_are_are_refused():
    with pytest.raises(ValueError, match="`--gpus` must be at most the 1 GPUs of this machine, got 2"):
        slot_environments(None, Limits(threads=1, timeout=None, memory=None, gpus=2), 1)


def test_a_worker_has_its_environment_before_it_works(monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "all")
    seen = []
    monkeypatch.setattr("dfd.batch.worker.work", lambda job: seen.append((job, os.environ["CUDA_VISIBLE_DEVICES"])))

    class Pipe:
        jobs = ["one", "two"]  # noqa: RUF012

        def recv(self):
            if not self.jobs:
                raise EOFError
            return self.jobs.pop(0)

        def send(self, outcome):
            assert outcome is None

    before = signal.getsignal(signal.SIGINT)
    try:
        pool._serve(Pipe(), {"CUDA_VISIBLE_DEVICES": "1"})
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [("one", "1"), ("two", "1")]


class Ray:
    """What of Ray the slots ask, keeping what they promise."""

    exceptions = SimpleNamespace(RayError=RuntimeError)

    def __init__(self, **there):
        self.there, self.promised = there, {}

    def cluster_resources(self):
        return self.there

    def remote(self, **promised):
        self.promised = promised
        return lambda function: SimpleNamespace(remote=lambda job: (function, job))


def test_ray_is_promised_what_a_task_needs():
    ray = Ray(CPU=8.0, GPU=2.0, memory=2.0**40)
    slots = RaySlots(ray, Limits(threads=3, timeout=9.0, memory=1 << 30, gpus=0.5))
    assert ray.promised == {"num_cpus": 3, "num_gpus": 0.5, "memory": 1 << 30, "max_retries": 0, "max_calls": 0}
    slots.submit("a job")
    assert list(slots._running) == [(work, "a job")]


def test_ray_without_gpus_is_refused():
    with pytest.raises(ValueError, match="`--gpus` must be at most what the Ray cluster has, 0, got 1"):
        RaySlots(Ray(CPU=8.0), Limits(threads=1, timeout=None, memory=None, gpus=1))


def test_the_command_hands_gpus_on(monkeypatch, tmp_path):
    """Two GPUs are said to be there: every shape is tried on one, and where there is none in truth says so."""
    chair = tmp_path / "chair.ply"
    dfd.samples.chair(4000).mesh.save(chair)
    save_tiny_encoder(tmp_path / "tiny")
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    handed = []
    monkeypatch.setattr(pool, "ProcessSlots", lambda environments: handed.append(environments) or Here())
    arguments = ["batch", str(chair), "-o", str(tmp_path / "out"), "--step", "distill", "--gpus", "0.5"]
    arguments += ["--encoder", str(tmp_path / "tiny"), "--threads", "4", "--memory", "100"]
    result = CliRunner().invoke(app, arguments)
    assert [each["CUDA_VISIBLE_DEVICES"] for each in handed[0]] == ["0", "0", "1", "1"]
    settings = BatchSettings.model_validate_json((tmp_path / "out" / "batch.json").read_text())
    assert settings.device == "cuda"
    if not torch.cuda.is_available():
        assert result.exit_code == 1
        (record,) = Here.done
        assert record.status == "failed"
        assert "cuda" in record.message.lower()


class Here:
    """Slots that work in this process."""

    done: list[Record] = []  # noqa: RUF012

    def __init__(self):
        self.jobs: list[Job] = []

    def free(self):
        return not self.jobs

    def submit(self, job):
        self.jobs.append(job)

    def wait(self, seconds):
        found = [(job, work(job)) for job in self.jobs]
        Here.done[:] = [outcome for _, outcome in found]
        self.jobs.clear()
        return found

    def close(self):
        self.jobs.clear()
