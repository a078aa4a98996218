"""Compare posed shapes with recorded ones. After a change that is meant, record again with `DFD_RECORD=1`.

Any change of a constant or a rule of the weights changes some of these numbers. So who makes one sees which gestures it
changes, and looks at them.
"""

import json
import os
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from recording import rounded, same

import dfd
from dfd.app.options import SAMPLE_FIELDS
from dfd.editing.controls import Controls
from dfd.editing.report import largest_stretch
from dfd.editing.weights import handle_features
from dfd.geometry import coarse
from dfd.geometry.coarse import nodes_of

RECORDED = Path(__file__).parent / "recorded" / "gestures.json"
FOLLOWED = 12  # number of vertices whose positions are compared

PULL, TURN = {"translation": (0.1, 0.15, -0.05)}, {"rotation": (20, 35, 10)}
GESTURES = {
    "pull": [("tip", PULL)],
    "at rest": [("tip", {})],
    "small pull": [("tip", {"translation": (0.003, 0.004, 0)})],
    "pull at the middle": [("middle", {"translation": (0, -0.6, 0.1)})],
    "far pull": [("tip", {"translation": (0.9, 0.2, 0.4)})],
    "turn": [("tip", TURN)],
    "grow": [("tip", {"scale": (1.2, 1.5, 0.8)})],
    "bend": [("tip", {"bend": 50, "towards": "front"})],
    "bend at a joint": [("tip", {"bend": 60, "towards": "left", "joint": "auto", "twist": 20})],
    "twist": [("tip", {"twist": 70, "joint": "here"})],
    "open": [("tip", {"open": 25})],
    "smaller": [("tip", {**TURN, "level": -1})],
    "larger": [("tip", {**TURN, **PULL, "level": 1})],
    "middle of the part": [("middle", {**PULL, **TURN})],
    "about the middle": [("tip", {**TURN, "pivot": "middle"})],
    "only this one": [("tip", {**PULL, "follow": "none"})],
    "one pivot": [("tip", {**TURN, "counterparts": "shared_pivot"})],
    "weights by features": [("tip", {**PULL, **TURN, "reach": 0.6})],
    "weights by features, one pivot": [
        ("tip", {**TURN, "reach": 0.8, "falloff": "sharp", "counterparts": "shared_pivot"})
    ],
    "near": [("tip", {**PULL, "locality": 3.0})],
    "within a radius": [("tip", {**PULL, "radius": "30%", "reach": 0.9})],
    "half": [("tip", {**PULL, "strength": 0.5})],
    "masked": [("tip", {**PULL, "mask": "x>0.05", "mask_feather": "5%"})],
    "point off the surface": [("off", PULL)],
    "region": [("region", PULL)],
    "two parts": [("tip", PULL), ("other", TURN)],
    "two handles on one part": [("tip", PULL), ("middle", {"translation": (-0.1, 0, 0.1)})],
    "a part in a part": [("tip", {**PULL, "level": -1}), ("middle", {**TURN, "level": 1})],
}
HOW = {
    "pull": {"symmetry": "x"},
    "far pull": {"default": {"translation": (0, 0.1, 0)}},
    "turn": {"symmetry": "x"},
    "near": {"symmetry": "x"},
    "weights by features": {"fixed": 0.7},
    "larger": {"fixed": 0.5},
}


@cache
def sample_of(name):
    """Return a sample, its field, its planes, its parts and its features.

    Of "large robot", vertices are grouped into mesh nodes, and features are compact, as if it had a million faces.
    """
    kind, large = name.removeprefix("large "), name.startswith("large ")
    sample = getattr(dfd.samples, kind)()
    field = dfd.Field.load(SAMPLE_FIELDS / f"{kind}.field.safetensors")
    planes = dfd.symmetry_planes(sample.mesh, field)
    with (
        mock.patch.object(coarse, "MOST_NODES", 2000 if large else coarse.MOST_NODES),
        mock.patch.object(coarse, "CELLS", 40),
        mock.patch.object(handle_features, "MOST_EXACT", 2000 if large else handle_features.MOST_EXACT),
    ):
        session = dfd.Deformer(sample.mesh, field)
        assert nodes_of(sample.mesh).are_vertices != large
        return sample, field, planes, session.bound.prepare(planes), session.features


def places(name, sample):
    """Return the places that the gestures name, on a limb of the sample and on another part."""
    mesh, limb, other = sample.mesh, *{"quadruped": ("leg", "head"), "robot": ("arm", "head")}[name.split()[-1]]
    own = sample.vertices_of(limb, 0)
    height = mesh.vertices[own, 1]
    beside = sample.vertices_of(other)
    tip = int(own[height.argmin()])
    return {
        "tip": tip,
        "middle": int(own[np.abs(height - np.median(height)).argmin()]),
        "off": tuple(mesh.vertices[tip] - (0, 0.03, 0)),
        "region": own[height < np.quantile(height, 0.3)],
        "other": int(beside[mesh.vertices[beside, 1].argmax()]),
    }


def told(name, gesture):
    """Return numbers about the shape that a gesture gives."""
    sample, field, planes, parts, features = sample_of(name)
    session = dfd.Deformer(sample.mesh, field, features=features)
    session.bound.prepare(planes, parts)
    at, how = places(name, sample), HOW.get(gesture, {})
    session.symmetry = how.get("symmetry")
    if "fixed" in how:
        session.fix(at["other"], strength=how["fixed"])
    if "default" in how:
        session.set_default(**how["default"])
    for place, values in GESTURES[gesture]:
        controls = {key: value for key, value in values.items() if key in Controls.__dataclass_fields__}
        handle = session.add(at[place], **controls)
        session.move(handle, **{key: value for key, value in values.items() if key not in controls})
    moved = session.vertices - sample.mesh.vertices
    some = np.linspace(0, len(moved) - 1, FOLLOWED).astype(int)
    return {
        "report": str(session.report()),
        "pivots": [handle.transform.pivot for handle in session.handles],
        "moved": float(np.linalg.norm(moved, axis=1).sum()),
        "mean": moved.mean(axis=0).tolist(),
        "stretch": largest_stretch(sample.mesh.vertices, session.vertices, sample.mesh.faces),
        "weights": [session.weights.sum(axis=0).tolist(), session.following.sum(axis=0).tolist()],
        "counterparts": [len(session.counterparts(handle.id)) for handle in session.handles],
        "vertices": session.vertices[some].round(5).tolist(),
    }


@pytest.mark.parametrize("name", ["quadruped", "robot", "large robot"])
@pytest.mark.parametrize("gesture", GESTURES)
def test_a_gesture_gives_the_recorded_shape(name, gesture):
    now, key = told(name, gesture), f"{name}: {gesture}"
    recorded = json.loads(RECORDED.read_text()) if RECORDED.exists() else {}
    if os.environ.get("DFD_RECORD"):
        recorded[key] = rounded(now, 5)
        lines = ",\n".join(f"{json.dumps(each)}: {json.dumps(recorded[each])}" for each in sorted(recorded))
        RECORDED.write_text(f"{{\n{lines}\n}}\n")
    differ = {
        each: (now[each], recorded[key][each]) for each in now if not same(now[each], recorded[key][each], 1e-3, 2e-5)
    }
    assert not differ
