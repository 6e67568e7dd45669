import numpy as np
import pytest

from ps_fmu.pointing.windows import count_samples
from ps_fmu.results.observers.observer import find_columns
from ps_fmu.results.observers.statistics import Statistics


def test_columns_are_found_in_the_order_of_the_names(columns):
    assert find_columns(columns, ["b.u", "a.x"]) == [2, 0]


def test_unknown_column_is_named_with_the_closest(columns):
    with pytest.raises(KeyError, match=r"no column named a\.z: the closest are a\.[xy]"):
        find_columns(columns, ["a.x", "a.z"])


def test_no_names_are_refused(columns):
    with pytest.raises(ValueError, match="at least one column"):
        Statistics(columns, [])


@pytest.mark.parametrize(("duration", "step", "rows"), [(1.0, 1e-4, 10000), (0.3, 0.1, 3), (1e-4, 1e-4, 1)])
def test_durations_are_counted_in_steps(duration, step, rows):
    assert count_samples(duration, step, "window") == rows


@pytest.mark.parametrize("duration", [0.0, -1.0, 0.05, 0.25, float("nan"), float("inf")])
def test_fractions_of_a_step_are_refused(duration):
    with pytest.raises(ValueError, match="window"):
        count_samples(duration, 0.1, "window")


def test_half_a_step_is_refused_in_long_durations():
    with pytest.raises(ValueError, match="window"):
        count_samples(60.00005, 1e-4, "window")


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan")])
def test_impossible_steps_are_refused(step):
    with pytest.raises(ValueError, match="step"):
        count_samples(1.0, step, "window")


@pytest.mark.parametrize("cuts", [(), (3,), (5,), (7,)])
def test_rows_before_the_start_are_left_out(columns, feed, cuts):
    values = np.zeros((10, 4))
    values[:5] = 1.0
    result = feed(Statistics(columns, ["a.x"], start_s=0.5), values, 0.1, cuts).result()
    assert result.count == 5
    assert result.peak == 0.0
