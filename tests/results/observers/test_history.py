"""All rows of some signals."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from ps_fmu.results.observers.history import HistoryObserver

COLUMNS = [SimpleNamespace(name=name, unit="m") for name in ("a", "b", "c")]


@pytest.mark.parametrize("cuts", [(0, 10), (0, 1, 10), (0, 3, 7, 10)])
def test_every_row_is_kept_however_the_run_is_cut(cuts):
    observer = HistoryObserver(COLUMNS, ("c", "a"))
    values = np.arange(30.0).reshape(10, 3)
    for first, last in pairwise(cuts):
        observer.block(first, np.arange(first, last) * 0.1, values[first:last])
    for _ in range(2):  # a result does not use it up
        np.testing.assert_array_equal(observer.result(), values[:, [2, 0]].T)


def test_a_run_without_rows():
    with pytest.raises(ValueError, match="no rows seen"):
        HistoryObserver(COLUMNS, ("a",)).result()
