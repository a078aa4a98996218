"""Test how the border of a part moves to a crease, on a strip of places."""

from types import SimpleNamespace

import numpy as np
import pytest

from dfd.segmentation.border import snapped
from dfd.segmentation.patches import Borders, _contracted

PLACES, PER_PATCH, ROWS = 32, 4, 3
STEP = 0.01  # distance between neighboring places
SPACING = 3 * STEP  # patch spacing


def strip(crease: int, linked: int | None = None, at: float = 99.0) -> SimpleNamespace:
    """Return the patches of a strip of `ROWS` rows of places, with a concave crease before the column `crease`.

    A patch has `PER_PATCH` columns. If given, `linked` is a place to which a gap joins one more place, the last one, at
    the column `at`. It belongs to the last patch.
    """
    number = np.arange(ROWS * PLACES).reshape(ROWS, PLACES)
    pairs = [
        np.stack([a.ravel(), b.ravel()], 1) for a, b in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:]))
    ]
    joined = np.concatenate(pairs if linked is None else [*pairs, [[linked, number.size]]])
    row, column = np.divmod(np.arange(joined.max() + 1), PLACES)
    row[number.size :], column[number.size :] = 0, PLACES - 1
    center = STEP * np.stack([np.where(np.arange(len(row)) < number.size, column, at), row, 0 * row], axis=1)
    lean = np.where(column < crease, 0.6, -0.6)
    normal = np.stack([lean, 0 * lean, np.sqrt(1 - lean**2)], axis=1)
    length = np.where(joined.max(axis=1) < number.size, STEP, 0.0)
    of_place = column // PER_PATCH
    places = Borders(joined, length, center, normal)
    of_patches, along = _contracted(of_place, joined, length, PLACES // PER_PATCH)
    middle = np.stack([np.bincount(of_place, axis) / np.bincount(of_place) for axis in center.T], axis=1)
    patches = Borders(of_patches, along, middle, np.tile([0.0, 0, 1], (len(middle), 1)))
    return SimpleNamespace(place_borders=places, borders=patches, of_place=of_place, spacing=SPACING)


def column_of_border(patches: SimpleNamespace, first: int = 4) -> list[int]:
    """Return the first column of each row outside the part, if the part has the patches before `first`."""
    inside = np.arange(PLACES // PER_PATCH) < first
    found = snapped(patches, inside)[: ROWS * PLACES].reshape(ROWS, PLACES)
    assert all((np.diff(row.astype(int)) <= 0).all() for row in found)
    return found.sum(axis=1).tolist()


@pytest.mark.parametrize("crease", [14, 16, 18])
def test_a_border_moves_to_a_crease_nearby(crease):
    assert column_of_border(strip(crease)) == [crease] * ROWS


def test_a_border_moves_at_most_one_patch_spacing():
    reach = int(SPACING / STEP)
    assert column_of_border(strip(16 + reach)) == [16 + reach] * ROWS
    assert column_of_border(strip(16 + reach + 2))[0] <= 16 + reach


def test_a_part_of_one_patch_keeps_its_middle():
    moved = column_of_border(strip(1), first=1)
    assert moved[0] > 1


def test_the_held_place_stays_in_the_part():
    assert not snapped(strip(14), np.arange(8) < 4)[15]
    assert snapped(strip(14), np.arange(8) < 4, held=15)[15]


def test_a_part_without_a_border_does_not_change():
    assert snapped(strip(14), np.ones(8, bool)).all()


def test_places_across_a_gap_follow_the_place_to_which_they_are_linked():
    """A loose place belongs to the last patch, and a link joins it to a place inside the part."""
    inside = np.arange(8) >= 4
    found = snapped(strip(18, PLACES - 1), inside)
    assert found[ROWS * PLACES]


@pytest.mark.parametrize(("linked", "inside"), [(17, False), (18, True)])
def test_a_place_across_a_gap_at_the_border_is_on_the_side_of_its_link(linked, inside):
    found = snapped(strip(18, linked, linked + 0.4), np.arange(8) >= 4)
    assert found[[linked, ROWS * PLACES]].tolist() == [inside, inside]
