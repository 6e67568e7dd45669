"""Columns come out of rows as they are, and the largest magnitude is found."""

import math

import numpy as np
import pytest

from ps_fmu.reduction.columns import ColumnCopy, complete_rows, find_peak

ROWS = np.random.default_rng(4).standard_normal((71, 9))


@pytest.mark.parametrize("places", [[], [8], [0, 4, 3], list(range(9))])
@pytest.mark.parametrize("count", [0, 1, 31, 32, 33, 71])
def test_columns_lie_side_by_side(count, places):
    room = np.full((len(places) + 1, 80), np.nan)
    result = room[:-1, 5 : 5 + count]
    ColumnCopy(places, 9).run(ROWS[:count], result)
    np.testing.assert_array_equal(result, ROWS[:count, places].T)
    assert np.isnan(room).sum() == room.size - result.size  # nothing else was written


@pytest.mark.parametrize(("places", "count"), [([], 5), ([0, 4], 0), ([], 0)])
def test_nothing_is_copied_to_where_nothing_is(places, count):
    result = np.empty((len(places), count))
    ColumnCopy(places, 9).run(ROWS[:count], result)
    with pytest.raises(ValueError, match="result"):
        ColumnCopy([0, 4], 9).run(ROWS[:5], result)


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


def test_peak_of_what_is_empty_or_has_gaps():
    assert find_peak(np.empty((0, 3))) == 0.0
    assert find_peak(ROWS[:, ::4]) == np.abs(ROWS[:, ::4]).max()


@pytest.mark.parametrize(("reals", "ints"), [(9, 0), (0, 1), (0, 2), (4, 1), (3, 5), (90, 30), (0, 0)])
@pytest.mark.parametrize("count", [0, 1, 40, 400])
def test_c_ints_become_doubles_in_place(count, reals, ints):
    rng = np.random.default_rng(reals)
    numbers = rng.integers(-(2**31), 2**31, (count, ints), dtype=np.int32)
    numbers[:1], numbers[1:2] = -(2**31), 2**31 - 1
    rows = np.full((count, reals + ints), np.nan)
    rows[:, :reals] = rng.standard_normal((count, reals)) * 1e9
    rows[:, reals:].view(np.int32)[:, :ints] = numbers
    expected = np.hstack([rows[:, :reals], numbers.astype(float)])
    again = rows.copy()
    assert complete_rows(rows, reals) == np.abs(expected).max(initial=0.0)
    np.testing.assert_array_equal(rows, expected)
    if count and reals:
        again[count // 2, reals - 1] = math.inf
        assert math.isnan(complete_rows(again, reals))
        np.testing.assert_array_equal(again[:, reals:], expected[:, reals:])


def test_rows_that_cannot_be_completed_are_refused():
    for wrong, reals in ((ROWS[:, ::-1], 3), (ROWS, 10), (ROWS, -1), (ROWS.astype(np.float32), 3), (ROWS[0], 3)):
        with pytest.raises(ValueError, match="expected contiguous rows"):
            complete_rows(wrong, reals)


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
