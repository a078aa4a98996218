"""Send sequences of requests, some of them damaged, to a session of the app."""

import base64
import json
import tempfile
from pathlib import Path
from typing import Any, get_args

import numpy as np
from hypothesis import strategies as st
from made_field import field_of
from mesh_files import CORNERS, CUBE

import dfd
from dfd.app.options import SessionOptions
from dfd.app.protocol.requests import RequestError, read_request
from dfd.app.session import requests
from dfd.app.session.exports import Kind
from dfd.app.session.session import Session

from .mutation import damaged_json

__all__ = ["ask_all", "page_input"]

SHAPE = dfd.Mesh(CORNERS, CUBE)
ZERO, ONE = [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]
MASK = base64.b64encode(bytes([0b1011])).decode()
TRANSFORM = {
    "translation": [0, 0.3, 0],
    "rotation": [0, 30, 0],
    "scale": ONE,
    "pivot": "auto",
    "bend": 20.0,
    "twist": 5,
}
CONTROLS = {
    "reach": 0.7,
    "falloff": 0.8,
    "counterparts": "own_pivot",
    "locality": 1.0,
    "strength": 0.5,
    "level": -1,
    "name": "a",
}
TURNED = {"handle": 1, "translation": [0, 0.1, 0], "rotation": [0, 0, 90], "scale": ONE, "twist": 10}
ASKED: list[dict[str, Any]] = [  # valid requests of all types, except those that start processes or open samples
    *({"type": "add", "at": at} for at in (7, {"mask": MASK})),
    {"type": "probe", "vertex": 3},
    *({"type": "take_part", "handle": 1, "how": how} for how in ("smaller", "larger")),
    {"type": "take_part", "vertex": 1, "handle": 1, "how": "add"},
    *({"type": name} for name in ("features", "suggest", "clear", "cancel")),
    *({"type": "go", "by": by} for by in (-1, 1)),
    *({"type": name, "handle": 1} for name in ("counterparts", "axis", "reset", "remove")),
    *({"type": name, "transforms": [TURNED]} for name in ("compute", "pose")),
    {"type": "move", "handle": 1, "transform": TRANSFORM, "controls": CONTROLS, "merge": True, "settle": True},
    {"type": "change", "handle": 1, "controls": {**CONTROLS, "mask": {"mask": MASK}}},
    {"type": "change", "handle": 1, "controls": {"mask": "part", "excluded_counterparts": [1], "radius": "10 %"}},
    {"type": "fix", "at": 4},
    {"type": "release", "index": 0},
    {"type": "change_fixed", "index": 0, "strength": 0.2, "merge": True},
    {"type": "set_symmetry", "plane": {"normal": [1, 0, 0], "offset": 0.5}, "band": 0.1},
    {"type": "set_symmetry", "plane": "x"},
    {"type": "set_preset", "preset": "paper"},
    {"type": "set_default", "transform": {"translation": [0, 1, 0], "rotation": [0, 0, 10]}},
    {"type": "set_poses", "poses": [{"name": "p", "seconds": 1, "transforms": [TURNED]}]},
    *({"type": "export", "format": kind, "transforms": [TURNED]} for kind in get_args(Kind)),
]


def page_input() -> st.SearchStrategy[bytes]:
    """Draw a list of requests, of which the first adds a handle."""
    first = [{"type": "add", "at": 0}, {"type": "move", "handle": 1, "transform": {"translation": [0, 0.1, 0]}}]
    one = st.sampled_from(ASKED)
    damaged = st.one_of(one, one.flatmap(damaged_json))
    several = st.lists(damaged, min_size=1, max_size=6)
    return several.map(lambda asked: json.dumps([*first, *asked]).encode())


def ask_all(path: Path) -> None:
    """Check that each request is answered once, without an internal error, and that vertices stay finite."""
    sent: list[dict[str, Any]] = []

    def send(message: str | bytes) -> None:
        sent.append(json.loads(message) if isinstance(message, str) else {})

    with tempfile.TemporaryDirectory() as folder:
        deformer = dfd.Deformer(SHAPE, field_of(SHAPE))
        session = Session(Path(folder), SessionOptions(deformer=deformer), send, lambda call: None)
        for number, asked in enumerate(json.loads(path.read_bytes()), start=1):
            sent.clear()
            try:
                text = json.dumps({**asked, "id": number} if isinstance(asked, dict) else asked)
                requests.answer(session, read_request(text))
            except RequestError as error:
                sent.append({"type": "failure", "message": str(error)})
            for message in sent:
                said = message.get("message") if message.get("type") == "failure" else None
                assert said is None or ("Internal error" not in said and "\n" not in said), (asked, said)
            assert np.isfinite(deformer.vertices).all(), asked
            session.guarded(0, session.run_deferred)
            assert not any("Internal error" in str(message.get("message")) for message in sent), asked
        session.close_shape()
