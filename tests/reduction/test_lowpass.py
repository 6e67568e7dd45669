"""The compiled low-pass gives the bits of numpy, whatever is filtered beside a column."""

import numpy as np
import pytest

from ps_fmu.reduction import lowpass
from ps_fmu.reduction.lowpass import Lowpass


def run(taps, factor, rows):
    one = Lowpass(taps, factor, rows.shape[1])
    result = np.full((one.count(len(rows)), rows.shape[1]), np.nan)
    one.run(rows, result)
    return result


@pytest.mark.parametrize("factor", [1, 2, 5])
@pytest.mark.parametrize("columns", [1, 3, 4, 7, 8, 31, 32, 33, 94])
def test_c_and_numpy_agree_to_the_bit(columns, factor, monkeypatch):
    rng = np.random.default_rng(columns)
    rows, taps = rng.standard_normal((150, columns)), rng.standard_normal(23)
    compiled = run(taps, factor, rows)
    assert lowpass.find_library() is not None
    monkeypatch.setattr(lowpass, "find_library", lambda: None)
    np.testing.assert_array_equal(run(taps, factor, rows), compiled)
    windows = np.lib.stride_tricks.sliding_window_view(rows, len(taps), axis=0)[::factor]
    np.testing.assert_allclose(compiled, windows @ taps, rtol=0.0, atol=1e-12)


def test_a_column_and_a_row_do_not_depend_on_their_neighbours():
    rng = np.random.default_rng(5)
    rows, taps = rng.standard_normal((200, 40)), rng.standard_normal(31)
    whole = run(taps, 3, rows)
    for columns in (slice(0, 2), slice(7, 8), slice(5, 30)):
        np.testing.assert_array_equal(run(taps, 3, np.ascontiguousarray(rows[:, columns])), whole[:, columns])
    np.testing.assert_array_equal(run(taps, 3, rows[3 * 11 :]), whole[11:])


@pytest.mark.parametrize("columns", [2, 8, 9, 31, 94])
def test_columns_that_rest_for_some_time_give_the_same_bits(columns, monkeypatch):
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
    compiled = run(taps, 5, rows)
    monkeypatch.setattr(lowpass, "find_library", lambda: None)
    np.testing.assert_array_equal(run(taps, 5, rows), compiled)


def test_arrays_that_do_not_fit_are_refused():
    one, rows = Lowpass(np.ones(5), 2, 3), np.ones((9, 3))
    with pytest.raises(ValueError, match="9 rows make 3, not 4"):
        one.run(rows, np.empty((4, 3)))
    for wrong in (np.ones((9, 4)), np.ones((9, 6))[:, ::2], np.ones((9, 3), dtype=np.float32)):
        with pytest.raises(ValueError, match="contiguous rows of 3 doubles"):
            one.run(wrong, np.empty((3, 3)))
