"""Compare the default weight with its formula, Eq. 9 to 12 of docs/how_it_works/method.md."""

import sys
from pathlib import Path

import numpy as np
import pytest
from test_contacts import FEET, box, joined, session_of

import dfd
import dfd.editing.weights
from dfd.app.options import SAMPLE_FIELDS
from dfd.editing.weights import fill, held_part

PACKAGE = Path(dfd.__file__).parent


def step(x):
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def opening(contact, motion):
    """Return δ and σ of Eq. 12 from points with the mean and the covariance of the contact."""
    values, axes = np.linalg.eigh(contact.spread)
    points = np.concatenate([side * np.sqrt(3) * (axes * values).T for side in (1, -1)])
    moved = points @ motion[:, :3].T
    shift = motion[:, :3] @ contact.center + motion[:, 3] - contact.center
    one, other = (np.cov(each.T, bias=True) for each in (points, moved))
    root = np.linalg.svd(contact.spread @ motion[:, :3] @ contact.spread, compute_uv=False).sum()
    apart = max(np.trace(one) + np.trace(other) - 2 * root, 0)
    return np.sqrt(shift @ shift + apart), np.sqrt(shift @ shift + np.square(moved - points).sum() / len(points))


def formula(mesh, component, motion):
    """Return the weights at `component.vertices` for a motion (3, 4)."""
    size, r, rho = mesh.diagonal, component.radius, component.room
    weights = component.share.copy()
    h = min(0.0125 * size, 0.2 * r) / 2
    across = along = np.zeros(1)
    if len(component.border):
        u = component.border @ motion[:, :3].T + motion[:, 3] - component.border
        along = (u @ component.direction).clip(0)
        across = np.linalg.norm(u - along[:, None] * component.direction, axis=1)
    o = min(max(h, 1.5 * across.max(), 3 * (1 - rho) * along.max()), component.outward)
    n = max(min(max(h, 3 * across.max() - o), component.inward), min(3 * along.max(), component.link))
    if len(component.border):
        weights *= step((component.depth + o) / (o + n))
    contacts = component.contacts
    if contacts is not None and contacts.kept:
        moves = [opening(each, motion) for each in contacts.kept]
        limits = [max(0.001 * size, sigma / 4) for _, sigma in moves]
        loose = min(max(min(0.001 * size, t - delta), 0) for t, (delta, _) in zip(limits, moves, strict=True))
        kept = max(3 * max(delta - t / 2, 0) for t, (delta, _) in zip(limits, moves, strict=True))
        weights *= step((contacts.apart + loose) / max(loose + min(kept, contacts.free), 1e-30))
    return weights


@pytest.fixture(scope="module")
def sessions():
    sample = dfd.samples.quadruped(4000)
    animal = dfd.Deformer(sample.mesh, dfd.Field.load(SAMPLE_FIELDS / "quadruped.field.safetensors"), other_shape=True)
    legs = [box(foot + (0, 0.4, 0), (0.12, 0.84, 0.12)) for foot in FEET]
    mesh, piece = joined(*legs, box((0, 0.85, 0), (1, 0.1, 1)))
    return {"animal": animal, "table": session_of(mesh, (piece == 4).astype(int))}


@pytest.mark.parametrize("name", ["animal", "table"])
@pytest.mark.parametrize(
    "motion",
    [
        {},
        {"translation": (0.03, -0.1, 0.02)},
        {"translation": (0, 2e-4, 1e-3)},
        {"translation": (0.2, 0.3, 0)},
        {"rotation": (10, 20, 30), "scale": 1.2},
    ],
)
def test_weights_are_those_of_the_formula(sessions, name, motion):
    session = sessions[name]
    mesh = session.mesh
    while session.undo():
        pass
    handle = session.add(int((mesh.vertices @ (1, -3, 1)).argmax()), follow="none", **motion)
    (component, *_) = session.bound.held(session.edit, session.handle(handle)).components
    wanted = np.zeros(len(mesh.vertices))
    wanted[component.core.vertices] = 1
    wanted[component.vertices] = formula(mesh, component, session.handle(handle).matrix)
    np.testing.assert_allclose(session.following[:, 0], wanted, atol=1e-4)
    assert ((wanted > 0.01) & (wanted < 0.99)).any() or name == "table"


def test_the_page_has_the_numbers_of_the_code():
    page = (Path(__file__).parents[3] / "docs" / "how_it_works" / "method.md").read_text("utf-8")
    assert (fill.STEEPEST / fill.STRAIN, fill.STRAIN, held_part.INSIDE, held_part.BEYOND, fill.SLIDING) == (
        3,
        0.5,
        0.5,
        0.2,
        0.25,
    )
    for number in (fill.REST, fill.REST_OF_RADIUS, held_part.OUTSIDE, fill.VISIBLE, fill.STRAIN):
        assert f"{number:g}" in page


def entered(work):
    """Return the files of the package that `work` enters, as paths."""
    found = set()
    sys.setprofile(lambda frame, event, _: found.add(frame.f_code.co_filename))
    try:
        work()
    finally:
        sys.setprofile(None)
    return {Path(name).relative_to(PACKAGE).as_posix() for name in found if name.startswith(f"{PACKAGE}")}


def test_one_handle_enters_few_files_and_none_of_several_handles_pieces_or_features(sessions):
    """The numbers are those of November 2026, so that what a reader of one handle must follow does not grow."""
    session = dfd.Deformer(sessions["animal"].mesh, sessions["animal"].field, other_shape=True)
    first = entered(lambda: (session.add("top", translation=(0, 0.1, 0)), session.vertices))
    assert np.abs(session.vertices - session.mesh.vertices).max() > 0.05
    later = entered(lambda: (session.move(1, translation=(0, 0.12, 0)), session.vertices))
    assert len(later) <= 15
    steps = {Path(name).stem for name in first if name.startswith("editing/weights/")}
    assert {"session_weights", "held_part", "fill"} <= steps
    assert not {"axis_motions", "by_features", "contacts", "fixed_points", "of_handles", "several_handles"} & steps
    assert len(first) <= 43
