"""The low-pass gives the bits of its sum, whatever is filtered beside a column, however rows are cut."""

import numpy as np
import pytest

from ps_fmu.reduction.lowpass import Lowpass, Thinning


def run(taps, factor, rows):
    one = Lowpass(taps, factor, rows.shape[1])
    result = np.full((one.count(len(rows)), rows.shape[1]), np.nan)
    one.run(rows, result)
    return result


def sum_in_order(taps, factor, rows):
    """``y[k] = sum_j h[j] x[k m + j]``, in the order of j, each operation rounded."""
    windows = np.lib.stride_tricks.sliding_window_view(rows, len(taps), axis=0)[::factor]
    result = np.zeros(windows.shape[:2])
    for place, tap in enumerate(taps):
        result += windows[:, :, place] * tap
    return result


@pytest.mark.parametrize("factor", [1, 2, 5])
@pytest.mark.parametrize("columns", [1, 3, 4, 7, 8, 31, 32, 33, 94])
def test_the_bits_are_those_of_the_sum(columns, factor):
    rng = np.random.default_rng(columns)
    rows, taps = rng.standard_normal((150, columns)), rng.standard_normal(23)
    np.testing.assert_array_equal(run(taps, factor, rows), sum_in_order(taps, factor, rows))


def test_a_column_and_a_row_do_not_depend_on_their_neighbours():
    rng = np.random.default_rng(5)
    rows, taps = rng.standard_normal((200, 40)), rng.standard_normal(31)
    whole = run(taps, 3, rows)
    for columns in (slice(0, 2), slice(7, 8), slice(5, 30)):
        np.testing.assert_array_equal(run(taps, 3, np.ascontiguousarray(rows[:, columns])), whole[:, columns])
    np.testing.assert_array_equal(run(taps, 3, rows[3 * 11 :]), whole[11:])


@pytest.mark.parametrize("columns", [2, 8, 9, 31, 94])
def test_columns_that_rest_for_some_time_give_the_same_bits(columns):
    """Also those beside them, and those that begin to move with the last row of a window."""
    rng = np.random.default_rng(columns)
    rows, taps = rng.standard_normal((1200, columns)), rng.standard_normal(23)
    for column in range(0, columns, 3):
        first, last = np.sort(rng.integers(0, 1201, 2))
        rows[first:last, column] = rng.standard_normal()
    rows[:, columns // 2 :: 4] = rows[0, columns // 2 :: 4]
    rows[-1, columns // 2] += 1.0
    rows[600:, 0] = 0.0
    rows[700:, 0] = -0.0
    np.testing.assert_array_equal(run(taps, 5, rows), sum_in_order(taps, 5, rows))


@pytest.mark.parametrize("sampled", [[], [2], [0, 9, 10]])
@pytest.mark.parametrize("size", [1, 4, 22, 23, 27, 60, 400])
def test_rows_that_come_in_parts_give_the_same_bits(size, sampled):
    rng = np.random.default_rng(size)
    first, rows = rng.standard_normal((11, 11)), rng.standard_normal((400, 11))
    taps, chosen = rng.standard_normal(23), np.isin(np.arange(11), sampled)
    whole = np.concatenate((first, rows))
    expected = sum_in_order(taps, 5, whole)
    expected[:, sampled] = whole[11::5][: len(expected), sampled]
    one = Thinning(taps, 5, chosen)
    one.waiting = first
    found = [one.push(rows[begin : begin + size]) for begin in range(0, 400, size)]
    np.testing.assert_array_equal(np.concatenate(found), expected)
    np.testing.assert_array_equal(one.waiting, whole[5 * len(expected) :])


def test_parts_that_do_not_fit_are_refused():
    for taps in (np.ones(4), np.ones(5)):
        with pytest.raises(ValueError, match="taps: expected an odd number above 5"):
            Thinning(taps, 5, np.zeros(3, dtype=bool))
    one = Thinning(np.ones(7), 2, np.zeros(3, dtype=bool))
    with pytest.raises(ValueError, match="less than 7 rows, got 7"):
        one.waiting = np.ones((7, 3))
    for wrong in (np.ones((9, 4)), np.ones((9, 6))[:, ::2], np.ones((9, 3), dtype=np.float32)):
        with pytest.raises(ValueError, match="contiguous rows of 3 doubles"):
            one.push(wrong)
    assert len(one.waiting) == 0


def test_arrays_that_do_not_fit_are_refused():
    one, rows = Lowpass(np.ones(5), 2, 3), np.ones((9, 3))
    with pytest.raises(ValueError, match="9 rows make 3, not 4"):
        one.run(rows, np.empty((4, 3)))
    for wrong in (np.ones((9, 4)), np.ones((9, 6))[:, ::2], np.ones((9, 3), dtype=np.float32)):
        with pytest.raises(ValueError, match="contiguous rows of 3 doubles"):
            one.run(wrong, np.empty((3, 3)))
