"""The targets of fuzzing: each reads one input by the public functions, and checks the result.

Invalid input must raise ValueError or OSError with a short message of one line.
"""

import importlib.util
import json
import tempfile
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from compressed_files import draco_cube, meshopt_cube, packed_glb
from hypothesis import strategies as st
from made_field import field_of, made_field
from mesh_files import CORNERS, CUBE, obj_cube, scene_of_three, textured_quad

import dfd
from dfd import Field, Mesh
from dfd.editing.edit_file import read_edit, write_edit
from dfd.export.export_parts import export_parts
from dfd.mesh.file.gltf.header import join_glb, split_glb
from dfd.posing.transforms import Transform

from .arrays import array_input, call_with_arrays, kernel_input, run_kernels
from .mutation import damaged_bytes, damaged_json
from .page import ask_all, page_input

SHAPE = Mesh(CORNERS, CUBE)
FIELD = made_field(4, width=8, layers=1, center=(0.5,) * 3, scale=2.0)
EXPORTS: list[tuple[str, Literal["skin", "morph", "baked"]]]
EXPORTS = [("skin.glb", "skin"), ("morph.glb", "morph"), ("baked.obj", "baked"), ("baked.ply", "baked")]
LONGEST_MESSAGE = 700  # characters

Bytes = st.SearchStrategy[bytes]
Target = tuple[Bytes, Callable[[Path], None]]


def run(check: Callable[[Path], None], path: Path) -> None:
    """Let `check` read `path`, and check the messages of the errors that it raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            check(path)
        except (ValueError, OSError) as error:
            if isinstance(error, UnicodeError) or "\n" in str(error) or len(str(error)) > LONGEST_MESSAGE:
                raise AssertionError(f"no message for people: {str(error)[:1000]!r}") from error


def load_mesh(path: Path) -> None:
    """Check that a mesh that loads is valid, and that a moved copy can be saved and loaded."""
    mesh = dfd.load(path)
    assert np.isfinite(mesh.vertices).all()
    assert 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices)
    assert mesh.parts
    assert np.isfinite(mesh.normals).all()
    with tempfile.TemporaryDirectory() as folder:
        for ending in {".glb", path.suffix}:
            saved = Path(folder, f"saved{ending}")
            mesh.save(saved, mesh.vertices * 0.5 + 1)
            dfd.load(saved)


def load_field(path: Path) -> None:
    """Check that a field that loads returns finite unit rows."""
    field = Field.load(path)
    rows = field(field.center + np.array([[0.0, 0, 0], [0.5, -1, 1]]) / field.scale)
    assert np.isfinite(rows).all()


def load_edit(path: Path) -> None:
    """Check that an edit that is read can be written, and is equal when read again."""
    mesh = Mesh(CORNERS, CUBE)
    edit = read_edit(path, mesh)
    with tempfile.TemporaryDirectory() as folder:
        again = Path(folder, "again.json")
        write_edit(again, edit, mesh)
        assert read_edit(again, mesh) == edit


def apply_edit(path: Path) -> None:
    """Check that an edit that is read gives finite vertices, and that every form of export loads again."""
    session = dfd.Deformer.load(path, SHAPE, FIELD)
    assert np.isfinite(session.vertices).all()
    assert "\n" not in str(session.report().warning or "")
    with tempfile.TemporaryDirectory() as folder:
        for name, form in EXPORTS:
            dfd.export_rig(session, Path(folder, name), form=form)
            dfd.load(Path(folder, name))
        dfd.export_weights(session, Path(folder, "weights.npz"))


def export_mesh(path: Path) -> None:
    """Check that every export of a mesh raises, or writes a file that loads again."""
    mesh = dfd.load(path)
    if len(mesh.vertices) > 1000 or not 1e-3 < mesh.diagonal < 1e3:
        return
    session = dfd.Deformer(mesh, field_of(mesh))
    session.add(0, translation=(0, 0.1, 0), counterparts="shared_pivot")  # without planes, which take most of the time
    calls: dict[str, Callable[[Path], object]] = {
        **{name: partial(dfd.export_rig, session, form=form) for name, form in EXPORTS},
        "parts.obj": lambda to: export_parts(mesh, dfd.parts(mesh, session.field).cut(), to),
        "parts.glb": lambda to: export_parts(mesh, dfd.parts(mesh, session.field).cut(), to),
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, call in calls.items():
            run(call, written := Path(folder, name))
            if written.exists():
                dfd.load(written)


def animate(path: Path) -> None:
    """Check that the key poses of an edit that is read give a file with an animation, which is read again."""
    session = dfd.Deformer.load(path, SHAPE, FIELD)
    with tempfile.TemporaryDirectory() as folder:
        dfd.export_rig(session, Path(folder, "animated.glb"))
        dfd.load(Path(folder, "animated.glb"))


def compressed(folder: Path) -> list[bytes]:
    """Return a GLB file for each decoder that is installed."""
    made = {"DracoPy": lambda: draco_cube().glb(), "meshopt": lambda: packed_glb(meshopt_cube())}
    return [make() for package, make in made.items() if importlib.util.find_spec(package)]


def seeds() -> Mapping[str, list[bytes]]:
    """Return valid files by file extension."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        found = {".glb": [textured_quad(folder).glb(), scene_of_three(folder).read_bytes()]}
        found["compressed"] = compressed(folder)
        posed = dfd.Deformer(SHAPE, FIELD)
        posed.add(0, translation=(0, 0.5, 0))
        for form in ("skin", "morph"):
            dfd.export_rig(posed, folder / f"{form}.glb", form=form)
        found["rigged"] = [(folder / f"{form}.glb").read_bytes() for form in ("skin", "morph")]
        for ending in (".obj", ".ply", ".stl", ".off"):
            Mesh(CORNERS, CUBE).save(folder / f"cube{ending}")
            found[ending] = [(folder / f"cube{ending}").read_bytes()]
        detailed = "mtllib a.mtl\no a\n" + obj_cube().replace(
            "f ", "vn 0 0 1\nvt 0 0\ng x\nusemtl q\nf 1/1/1 2//1 -1/-1\nf ", 2
        )
        found[".obj"].append(detailed.encode())
        made_field(4, width=8, layers=1, octaves=2).save(folder / "made.safetensors")
        found[".safetensors"] = [(folder / "made.safetensors").read_bytes()]
        deformer = dfd.Deformer(Mesh(CORNERS, CUBE), made_field(4, width=8, layers=1, center=(0.5,) * 3, scale=2.0))
        deformer.add(0, translation=(0, 1, 0), name="left horn")
        deformer.fix([1.0, 1.0, 0.5])
        turned = Transform((0, 1, 0), (0, 90, 0), (1, 2, 1))
        deformer.set_poses([dfd.KeyPose(0), dfd.KeyPose(1.5, {1: turned}, "turned")])
        deformer.save(folder / "made.json")
        found[".json"] = [(folder / "made.json").read_bytes()]
        return found


def damaged_glb(good: bytes) -> Bytes:
    """Draw a GLB file with damaged JSON and correct chunk sizes."""
    text, data = split_glb(good).values()
    return damaged_json(json.loads(text)).map(lambda header: join_glb(to_bytes(header), data or b""))


def damaged_data(good: bytes) -> Bytes:
    """Draw a GLB file with valid JSON and damaged binary data, which decoders read."""
    text, data = split_glb(good).values()
    longer = damaged_bytes(data or b"").map(lambda found: found[: len(data or b"")].ljust(len(data or b""), b"\0"))
    return longer.map(lambda found: join_glb(text, found))


def _targets() -> dict[str, Target]:
    good = seeds()

    def damaged(kind: str, damage: Callable[[bytes], Bytes] = damaged_bytes) -> list[Bytes]:
        return [damage(seed) for seed in good[kind]]

    edits = damaged_json(json.loads(good[".json"][0])).map(to_bytes)
    rigs = [*damaged("rigged", damaged_glb), *damaged(".glb", damaged_glb), *damaged("rigged", damaged_data)]
    made: dict[str, Target] = {
        **{f"mesh{ending}": (st.one_of(damaged(ending)), load_mesh) for ending in (".obj", ".ply", ".stl", ".off")},
        "mesh.glb": (st.one_of([*damaged(".glb"), *damaged(".glb", damaged_glb) * 3]), load_mesh),
        "exported.glb": (st.one_of(rigs), export_mesh),
        "field.safetensors": (damaged_bytes(good[".safetensors"][0]), load_field),
        "edit.json": (st.one_of(edits, edits, damaged_bytes(good[".json"][0])), load_edit),
        "applied.json": (edits, apply_edit),
        "animated.json": (edits, animate),
        "arrays.json": (array_input(), call_with_arrays),
        "page.json": (page_input(), ask_all),
        "kernels.json": (kernel_input(), run_kernels),
    }
    if good["compressed"]:
        streams = damaged("compressed", damaged_data) * 2 + damaged("compressed", damaged_glb)
        made["compressed.glb"] = (st.one_of(streams), load_mesh)
    return made


def to_bytes(document: object) -> bytes:
    """Return a JSON document as bytes."""
    return json.dumps(document).encode()


TARGETS = _targets()  # by the names of their input files
