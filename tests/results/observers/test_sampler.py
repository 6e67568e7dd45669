"""Rows of a run as they are: all, some, the last."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from ps_fmu.results.observers.sampler import HistoryObserver, LastRow, SampleObserver

COLUMNS = [SimpleNamespace(name=name, unit="m") for name in ("a", "b", "c")]


def test_rows_are_kept_whichever_block_they_come_in():
    observer = SampleObserver(COLUMNS, ("c", "a"), [0, 7, 3])
    values = np.arange(30.0).reshape(10, 3)
    for first, last in ((0, 4), (4, 9)):
        observer.block(first, np.arange(first, last) * 0.1, values[first:last])
    assert observer.values("a", "c").tolist() == [[0.0, 2.0], [21.0, 23.0], [9.0, 11.0]]


def test_rows_that_the_run_did_not_reach_are_no_numbers():
    observer = SampleObserver(COLUMNS, ("b",), [1, 5])
    observer.block(0, np.arange(3) * 0.1, np.ones((3, 3)))
    assert observer.values("b")[0] == 1.0 and np.isnan(observer.values("b")[1])


@pytest.mark.parametrize("cuts", [(0, 10), (0, 1, 10), (0, 3, 7, 10)])
def test_every_row_is_kept_however_the_run_is_cut(cuts):
    observer = HistoryObserver(COLUMNS, ("c", "a"))
    values = np.arange(30.0).reshape(10, 3)
    for first, last in pairwise(cuts):
        observer.block(first, np.arange(first, last) * 0.1, values[first:last])
    for _ in range(2):  # a result does not use it up
        np.testing.assert_array_equal(observer.result(), values[:, [2, 0]].T)


def test_a_run_without_rows():
    for observer in (HistoryObserver, LastRow):
        with pytest.raises(ValueError, match="no rows seen"):
            observer(COLUMNS, ("a",)).result()


def test_last_row():
    last = LastRow(COLUMNS, ["c", "a"])
    for first in (0, 3):
        last.block(first, np.arange(first, first + 3) * 0.1, np.arange(9.0).reshape(3, 3) + first)
    np.testing.assert_array_equal(last.result(), [11.0, 9.0])
