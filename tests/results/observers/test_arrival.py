from types import SimpleNamespace

import numpy as np
import pytest

from ps_fmu.results.observers.statistics import ArrivalObserver

COLUMNS = [SimpleNamespace(name=name, unit="1") for name in ("a", "moving", "b")]
STEP = 0.1


def observed(moving, settle_s=1.0, block=7):
    """The arrival of signals a = time and b = -time, cut into blocks."""
    time = np.arange(len(moving)) * STEP
    values = np.column_stack([time, moving, -time])
    observer = ArrivalObserver(COLUMNS, ["b", "a"], flag="moving", settle_s=settle_s)
    for first in range(0, len(time), block):
        observer.block(first, time[first : first + block], values[first : first + block])
    return observer.result()


def flags(count, *intervals):
    up = np.zeros(count)
    for first, last in intervals:
        up[first : last + 1] = 1.0
    return up


@pytest.mark.parametrize("block", [1, 7, 1000])
def test_a_motion_and_what_comes_after(block):
    found = observed(flags(60, (10, 29)), block=block)
    assert (found.began_s, found.ended_s) == (pytest.approx(1.0), pytest.approx(2.9))
    assert found.names == ("b", "a")
    assert (found.during.count, found.after.count) == (20, 30)
    np.testing.assert_allclose(found.during.mean, [-1.95, 1.95])
    np.testing.assert_allclose(found.after.peak, [5.9, 5.9])
    assert found.settled
    assert found.final_s == pytest.approx(3.9)
    np.testing.assert_allclose(found.value("a", "b"), [3.9, -3.9])


def test_the_last_of_several_motions_counts():
    found = observed(flags(60, (10, 19), (35, 36)))
    assert (found.began_s, found.ended_s) == (pytest.approx(1.0), pytest.approx(3.6))
    assert (found.during.count, found.after.count) == (12, 23)
    assert found.final_s == pytest.approx(4.6)


@pytest.mark.parametrize(("end", "count"), [(55, 4), (59, None)])
def test_a_run_that_ends_early_is_judged_at_its_end(end, count):
    found = observed(flags(60, (10, end)))
    assert not found.settled
    assert found.final_s == pytest.approx(5.9)
    assert (found.after.count if found.after else None) == count


def test_nothing_moves():
    found = observed(flags(60))
    assert (found.began_s, found.ended_s, found.during, found.after) == (None, None, None, None)
    assert not found.settled
    np.testing.assert_allclose(found.value("a"), 5.9)


def test_no_rows():
    with pytest.raises(ValueError, match="no rows"):
        ArrivalObserver(COLUMNS, ["a"], flag="moving", settle_s=1.0).result()
