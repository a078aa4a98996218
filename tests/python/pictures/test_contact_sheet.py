"""Test sheets of captioned pictures, and their text."""

import numpy as np
import pytest

from dfd.pictures.colors import weight_colors
from dfd.pictures.contact_sheet import contact_sheet, heat_bar
from dfd.pictures.labels import spelled


def filled(height, width, color):
    return np.full((height, width, 3), color, np.uint8)


def test_pictures_of_the_right_size_are_unchanged_on_the_page():
    random = np.random.default_rng(0)
    pictures = [random.integers(0, 256, (64, 64, 3), dtype=np.uint8) for _ in range(2)]
    page = np.array(contact_sheet([("", [(picture, "") for picture in pictures])], cell=64))
    margin, gap = 8, 4
    np.testing.assert_array_equal(page[margin : margin + 64, margin : margin + 64], pictures[0])
    np.testing.assert_array_equal(page[margin : margin + 64, margin + 64 + gap : margin + 128 + gap], pictures[1])
    page[margin : margin + 64, margin : margin + 128 + gap] = 255
    assert (page == 255).all()


@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        ([], {}, "at least one picture"),
        ([("", [(np.zeros((4, 4)), "")])], {}, "must be uint8 of shape"),
        ([("", [(np.zeros((0, 4, 3), np.uint8), "")])], {}, "must be uint8 of shape"),
        ([("", [(filled(4, 4, (0, 0, 0)), "")])], {"cell": 3}, "`cell` must be a whole number from 16"),
    ],
)
def test_refusals(rows, options, message):
    with pytest.raises(ValueError, match=message):
        contact_sheet(rows, **options)


@pytest.mark.parametrize("height", [16, 200, 512])
def test_heat_bar_runs_from_the_lowest_to_the_highest_weight(height):
    bar = heat_bar(height)
    assert bar.shape[0] == height
    column = bar[:, 1].astype(int)
    low, high = (weight_colors([0.0, 1.0]) * 255 + 0.5).astype(int)
    assert np.abs(column - high).sum(axis=1).min() == 0
    assert np.abs(column - low).sum(axis=1).argmin() > np.abs(column - high).sum(axis=1).argmin()


def test_text_is_spelled_with_letters_that_the_typeface_has():
    assert spelled("plain text, 30° … 2") == "plain text, 30° … 2"
    assert spelled("λ → 2²") == "lambda -> 22"
    assert spelled("−½ × café") == "-1/2 x cafe"
    assert spelled("日") == "?"
