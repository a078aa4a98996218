"""Test that fixed points hold the part of a handle, its counterparts and what looks like them."""

import numpy as np
import pytest
from prepared import sessions_on

import dfd
from dfd.app.options import SAMPLE_FIELDS

FRONT, BEHIND, LEFT = "0.115,0,0.245", "0.115,0,-0.29", "-0.115,0,0.245"


@pytest.fixture(scope="module")
def animal():
    """Return a sample of a quadruped, a function that makes sessions, and the vertices of each leg by its sides."""
    sample = dfd.samples.quadruped()
    fresh = sessions_on(sample.mesh, dfd.Field.load(SAMPLE_FIELDS / "quadruped.field.safetensors"), None)
    own = sample.vertices_of("hoof")
    x, _, z = sample.mesh.vertices[own].T
    return (
        sample,
        fresh,
        {(right, front): own[((x > 0) == right) & ((z > 0) == front)] for right in (0, 1) for front in (0, 1)},
    )


def moved(session):
    return np.linalg.norm(session.vertices - session.mesh.vertices, axis=1)


@pytest.mark.parametrize("strength", [1.0, 0.4])
def test_a_fixed_point_on_a_counterpart_keeps_it_and_no_other(animal, strength):
    _, fresh, hooves = animal
    session = fresh()
    session.add(FRONT, translation=(0, -0.2, 0))
    free = moved(session)
    session.fix(LEFT, strength=strength)
    held = moved(session)
    np.testing.assert_allclose(held[hooves[0, 1]], (1 - strength) * free[hooves[0, 1]], atol=1e-3)
    np.testing.assert_allclose(held[hooves[1, 1]], free[hooves[1, 1]], atol=1e-6)
    assert session.report().handles[0].arrived


@pytest.mark.parametrize("place", [BEHIND, "0.115,0.2,-0.29"])
def test_counterparts_that_look_like_the_fixed_leg_stay_too(animal, place):
    """The two legs behind look more like each other than like those in front."""
    _, fresh, hooves = animal
    session = fresh()
    session.add(FRONT, translation=(0, -0.2, 0))
    session.fix(place)
    held = moved(session)
    assert held[np.concatenate([hooves[0, 0], hooves[1, 0]])].max() < 1e-6
    assert held[np.concatenate([hooves[0, 1], hooves[1, 1]])].min() > 0.19


def test_a_fixed_point_on_the_part_of_a_handle_divides_the_part(animal):
    sample, fresh, hooves = animal
    session = fresh()
    handle = session.add(FRONT, translation=(0, -0.2, 0))
    knee = sample.mesh.vertices[np.linalg.norm(sample.mesh.vertices - (0.115, 0.2, 0.245), axis=1).argmin()]
    session.fix(knee)
    held, place = moved(session), np.asarray(session.handle(handle).place.position)
    assert session.report().handles[0].arrived
    for mirror in (1, -1):  # the counterpart is divided at the mirror image of the fixed point
        apart = [np.linalg.norm(sample.mesh.vertices - each * (mirror, 1, 1), axis=1) for each in (place, knee)]
        assert held[apart[1].argmin()] < 0.01
        near, far = np.square(apart)
        own = sample.vertices_of("hoof")[0:0] if mirror < 0 else hooves[1, 1]
        np.testing.assert_allclose(held[own], 0.2 * (far / (near + far))[own], atol=2e-3)
    assert session.report().stretch < 6
