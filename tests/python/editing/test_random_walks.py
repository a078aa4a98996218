"""Walk at random through the steps of a session, and compare the shape with that of a fresh session."""

import numpy as np
import pytest
from prepared import sessions_on
from test_contacts import FEET, box, joined

import dfd
from dfd.app.options import SAMPLE_FIELDS
from dfd.editing.key_pose import KeyPose


def table():
    """Return a table of five pieces, and a field that was made for another shape."""
    legs = [box(foot + (0, 0.4, 0), (0.12, 0.84, 0.12)) for foot in FEET]
    return joined(*legs, box((0, 0.85, 0), (1, 0.1, 1)))[0], "chair"


SHAPES = {
    "quadruped": lambda: (dfd.samples.quadruped(4000).mesh, "quadruped"),
    "robot": lambda: (dfd.samples.robot(4000).mesh, "robot"),
    "table": table,
}


def one_step(session, random, folder):
    """Change the session at random, and return the session that continues."""
    mesh, ids = session.mesh, [handle.id for handle in session.handles]
    at = int(random.integers(len(mesh.vertices)))
    motion = {
        "translation": 0.1 * mesh.diagonal * random.normal(size=3),
        "rotation": 30 * random.normal(size=3) * (random.random() < 0.4),
        "scale": float(random.uniform(0.7, 1.4)) if random.random() < 0.3 else 1.0,
    }
    controls = {
        "level": int(random.integers(-1, 2)),
        "counterparts": str(random.choice(["own_pivot", "shared_pivot"])),
        "follow": str(random.choice(["all", "mirror", "none"])),
        "reach": float(random.uniform(0.5, 1.2)) if random.random() < 0.2 else "part",
        "detach": bool(random.random() < 0.2),
    }
    verb = random.choice(
        ["add", "move", "drag", "change", "fix", "release", "remove", "undo", "redo", "poses", "load", "symmetry"],
        p=[0.16, 0.2, 0.2, 0.08, 0.05, 0.03, 0.06, 0.09, 0.05, 0.02, 0.02, 0.04],
    )
    try:
        if verb == "add" and len(ids) < 6:
            session.add(at, **controls, **(motion if random.random() < 0.7 else {}))
        elif verb in ("move", "drag") and ids:
            handle = int(random.choice(ids))
            for part in np.linspace(0.4, 1, 4 if verb == "drag" else 1):
                session.move(
                    handle, translation=part * motion["translation"], rotation=part * motion["rotation"], merge=True
                )
                _ = session.vertices
        elif verb == "change" and ids:
            session.change(int(random.choice(ids)), **controls)
        elif verb == "fix":
            session.fix(at, strength=float(random.uniform(0.3, 1)))
        elif verb == "release" and session.fixed:
            session.release(session.fixed[0].place.position)
        elif verb == "remove" and ids:
            session.remove(int(random.choice(ids)))
        elif verb in ("undo", "redo"):
            getattr(session, verb)()
        elif verb == "poses":
            session.set_poses([KeyPose(0.5, {handle.id: handle.transform for handle in session.handles})])
        elif verb == "load":
            session.save(folder / "edit.json")
            again = dfd.Deformer.load(
                folder / "edit.json", mesh, session.field, features=session.features, other_shape=True
            )
            assert again.edit == session.edit
        elif verb == "symmetry":
            session.symmetry = random.choice([None, "x"])
    except ValueError as error:
        known = ("already used", "distinct places", "must leave handle", "must be a fixed point")
        if not any(text in str(error) for text in known):
            raise


@pytest.mark.parametrize("steps", [40, pytest.param(300, marks=pytest.mark.slow)])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_session_gives_the_shape_of_a_fresh_session_after_every_step(shape, steps, tmp_path):
    mesh, name = SHAPES[shape]()
    field = dfd.Field.load(SAMPLE_FIELDS / f"{name}.field.safetensors")
    fresh = sessions_on(mesh, field, field.on(mesh).rows(np.arange(len(mesh.vertices))))
    session, other, random = fresh(), fresh(), np.random.default_rng(1)
    for number in range(steps):
        one_step(session, random, tmp_path)
        moved = session.vertices
        if number % 200 == 0:
            other = fresh()
        else:
            other.start_with(session.edit)
        other.apply(session.edit)
        np.testing.assert_allclose(moved, other.vertices, atol=1e-5 * mesh.diagonal, err_msg=f"step {number}")
        if number % 20 == 0:
            assert str(session.report())
            np.testing.assert_allclose(session.weights, other.weights, atol=1e-6)
