"""Columns come out of rows as they are, and the largest magnitude is found, compiled and in numpy."""

import math

import numpy as np
import pytest

from ps_fmu.reduction import columns
from ps_fmu.reduction.columns import ColumnCopy, find_peak

ROWS = np.random.default_rng(4).standard_normal((71, 9))


@pytest.fixture(params=[True, False], ids=["compiled", "numpy"])
def compiled(request, monkeypatch):
    if request.param:
        assert columns.find_library() is not None
    else:
        monkeypatch.setattr(columns, "find_library", lambda: None)


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize("places", [[], [8], [0, 4, 3], list(range(9))])
@pytest.mark.parametrize("count", [0, 1, 31, 32, 33, 71])
def test_columns_lie_side_by_side(count, places):
    room = np.full((len(places) + 1, 80), np.nan)
    result = room[:-1, 5 : 5 + count]
    ColumnCopy(places, 9).run(ROWS[:count], result)
    np.testing.assert_array_equal(result, ROWS[:count, places].T)
    assert np.isnan(room).sum() == room.size - result.size  # nothing else was written


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize("count", [1, 31, 32, 33, 639])
def test_the_peak_is_the_largest_magnitude(count):
    values = ROWS.reshape(-1)[:count].copy()
    assert find_peak(values) == np.abs(values).max()
    for place in (0, count // 2, count - 1):
        for largest in (-50.0, 1e300, -1.7e308):
            changed = values.copy()
            changed[place] = largest
            assert find_peak(changed) == abs(largest)
        for fault in (math.nan, math.inf, -math.inf):
            changed[place] = fault
            assert math.isnan(find_peak(changed))


@pytest.mark.usefixtures("compiled")
def test_peak_of_what_is_empty_or_has_gaps():
    assert find_peak(np.empty((0, 3))) == 0.0
    assert find_peak(ROWS[:, ::4]) == np.abs(ROWS[:, ::4]).max()


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="places: expected 0 to 8, got -1 to 3"):
        ColumnCopy([3, -1], 9)
    one = ColumnCopy([3, 1], 9)
    for wrong in (ROWS[:, :8], ROWS.astype(np.float32), ROWS[:, ::-1]):
        with pytest.raises(ValueError, match="contiguous rows of 9 doubles"):
            one.run(wrong, np.empty((2, 71)))
    for wrong in (np.empty((2, 70)), np.empty((3, 71)), np.empty((71, 2)).T, np.empty((2, 71))[:, ::-1]):
        with pytest.raises(ValueError, match=r"result: expected \(2, 71\) doubles"):
            one.run(ROWS, wrong)
    overlapping = np.lib.stride_tricks.as_strided(np.empty(100), (2, 71), (8, 8))
    with pytest.raises(ValueError, match="result"):
        one.run(ROWS, overlapping)
