"""Values of a run at given rows."""

from types import SimpleNamespace

import numpy as np

from ps_fmu.results.observers.sampler import SampleObserver

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
