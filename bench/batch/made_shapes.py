"""Made shapes of mixed kinds and formats, and bad ones, with a manifest of them all."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import trimesh

import dfd
from tests.python.made_field import made_field

ENDINGS = ("obj", "ply", "stl", "off", "glb")
# A pipe that nobody writes to, a file too large for a task's memory, and one whose worker is killed at every attempt.
HANGS, HOGS, KILLED = "bad-hangs", "bad-hogs", "bad-killed"
HUGE = 4_000_000  # triangles


def bad_names(folder: Path) -> list[str]:
    """Make the twenty bad shapes, and return their file names."""
    good = trimesh.creation.icosphere(3).export(file_type="glb")
    for number in range(4):
        (folder / f"bad-cut-{number}.glb").write_bytes(good[: 40 + 900 * number])
    for number in range(3):
        (folder / f"bad-empty-{number}.ply").write_bytes(b"")
        (folder / f"bad-noise-{number}.stl").write_bytes(np.random.default_rng(number).bytes(500))
        (folder / f"bad-nan-{number}.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for number in range(2):
        (folder / f"bad-index-{number}.off").write_text(f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {7 + number}\n")
    (folder / "bad-folder.obj").mkdir()
    os.mkfifo(folder / f"{HANGS}.obj")
    _huge(folder / f"{HOGS}.stl")
    trimesh.creation.icosphere(6).export(folder / f"{KILLED}.ply")
    names = sorted(path.name for path in folder.glob("bad-*"))
    return [*names, "bad-missing.obj"]


def make(folder: Path, count: int) -> Path:
    """Make `count` shapes, twenty of them bad, and their fields; return the manifest."""
    folder.mkdir()
    rows = [(name, "field.safetensors") for name in bad_names(folder)]
    made_field(64, width=64, layers=2).save(folder / "field.safetensors")
    random = np.random.default_rng(0)
    kinds = [
        *(getattr(dfd.samples, kind)(4000).mesh for kind in ("chair", "quadruped", "robot")),
        *(dfd.load(each) for each in (trimesh.creation.icosphere(4), trimesh.creation.torus(1.0, 0.3, 64, 32))),
    ]
    for number in range(count - len(rows)):
        kind = kinds[number % len(kinds)]
        stretched = kind.vertices * random.uniform(0.5, 2.0, 3)
        mesh = dfd.Mesh(stretched, kind.faces)
        name = f"made-{number:04d}"
        mesh.save(folder / f"{name}.{ENDINGS[number // len(kinds) % len(ENDINGS)]}")
        center, scale = mesh.bounds.mean(axis=0), 2 / max(mesh.extents)
        field = made_field(64, width=64, layers=2, seed=number % 7, center=center, scale=scale)
        field.save(folder / f"{name}.field.safetensors")
        rows.append((f"{name}.{ENDINGS[number // len(kinds) % len(ENDINGS)]}", f"{name}.field.safetensors"))
    manifest = folder / "manifest.csv"
    with manifest.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["path", "field", "name"])
        writer.writerows((path, field, Path(path).stem) for path, field in rows)
    return manifest


def _huge(path: Path) -> None:
    """Write a binary STL of many triangles, each somewhere else."""
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    part = np.zeros(HUGE // 8, triangle)
    random = np.random.default_rng(0)
    with path.open("wb") as stream:
        stream.write(b"\0" * 80 + np.uint32(HUGE).tobytes())
        for _ in range(8):
            part["corners"] = random.random((len(part), 3, 3), np.float32)
            stream.write(part.tobytes())
