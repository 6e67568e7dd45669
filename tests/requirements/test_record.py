from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter
from support.required import COLUMNS

from ps_fmu.requirements.record import RequirementRecord
from ps_fmu.requirements.requirement import INDICES, RequirementError, find_targets

STEP = 0.01


def observe(requirement, rows, blocks=(), step=STEP):
    """A record of rows (n, columns) that come in blocks, which end before the given rows."""
    record = RequirementRecord(requirement, COLUMNS, step, len(rows))
    edges = [0, *blocks, len(rows)]
    for first, last in pairwise(edges):
        record.block(first, np.arange(first, last) * step, rows[first:last].copy())
    return record


@pytest.mark.parametrize("symbol", INDICES)
def test_the_values_are_those_of_the_library(require, white, symbol):
    """RMS and peak of side-by-side windows, whatever the blocks, after the settling."""
    entries = {"at": "uniform" if symbol == "RPE" else None, "window": None if symbol == "APE" else "0.2 s"}
    if symbol in ("PDE", "PRE"):
        entries["separation"] = "0.3 s"
    requirement = require(index=symbol, settling="0.1 s", **entries)
    rows = lfilter([1.0], [1.0, -0.9], white(1003), axis=0)
    stride = 1 if symbol == "APE" else 20
    expected = requirement.index.values(rows[10:, 0], STEP, stride=stride)
    for blocks in ((), (3, 5, 200, 201, 900), tuple(range(7, 1003, 7))):
        (found,) = observe(requirement, rows, blocks).distributions
        assert found.count == expected.size
        assert found.peak == pytest.approx(np.abs(expected).max(), rel=1e-12)
        assert found.rms == pytest.approx(np.sqrt(np.mean(expected**2)), rel=1e-12)


def test_the_rpe_of_a_sine_in_whole_periods(require):
    """Amplitude 2 urad, 5 Hz, window 1 s: the mean is zero, so RPE is the sine itself, of RMS sqrt(2) urad."""
    rows = np.zeros((2001, len(COLUMNS)))
    rows[:, 0] = 2e-6 * np.sin(2.0 * np.pi * 5.0 * np.arange(2001) * STEP) + 1e-3  # a bias is no relative error
    (found,) = observe(require(), rows, (700,)).distributions
    assert found.count == 2000
    assert found.rms == pytest.approx(np.sqrt(2.0) * 1e-6, rel=1e-9)
    assert found.quantile(0.5) == pytest.approx(2e-6 * np.sin(2.0 * np.pi * 0.1), rel=2e-3)  # samples at 20 phases


def test_a_magnitude_and_each_axis(require):
    rows = np.zeros((10, len(COLUMNS)))
    rows[:, 0], rows[:, 1] = 3e-6, -4e-6
    ape = {"index": "APE", "window": None, "at": None, "signal": "plant.rotation"}
    norm = observe(require(combine="norm", **ape), rows)
    assert [target.label for target in norm.targets] == ["|plant.rotation|"]
    assert norm.distributions[0].peak == pytest.approx(5e-6)
    each = observe(require(**ape), rows)
    assert [target.label for target in each.targets] == ["plant.rotation.x", "plant.rotation.y"]
    assert [found.peak for found in each.distributions] == [3e-6, 4e-6]


def test_before_the_first_window_is_full_there_is_nothing(require, white):
    record = RequirementRecord(require(), COLUMNS, STEP, 1001)
    record.block(0, np.arange(99) * STEP, white(99))
    assert record.distributions == []
    record.block(99, np.array([0.99]), white(1))
    assert record.distributions[0].count == 100


@pytest.mark.parametrize(
    ("change", "labels"),
    [
        ({"signal": "plant.leg", "limit": "1 um"}, ["plant.leg_1", "plant.leg_2"]),
        ({"signal": ["plant.leg_2", "plant.los"], "limit": "1 um"}, ["plant.leg_2", "plant.los.x"]),
        ({"signal": "plant.rotation.y"}, ["plant.rotation.y"]),
    ],
)
def test_signals_by_the_names_of_vectors(require, change, labels):
    assert [target.label for target in find_targets(require(**change), COLUMNS)] == labels


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"signal": "plant.rotaton.x"}, "signal: there is no output 'plant.rotaton.x'; did you mean plant.rotation.x"),
        ({"signal": "plant.rotaton"}, "signal: there is no output 'plant.rotaton'; did you mean plant.rotation"),
        ({"signal": "plant.legs"}, "signal: there is no output 'plant.legs'; did you mean plant.leg, "),
        ({"signal": "plant"}, "signal: there is no output 'plant'"),
        ({"signal": "commander.reachable"}, "signal: commander.reachable is of the type Boolean: expected a Real"),
        ({"signal": "plant.los"}, "limit: plant.los.x: 'urad' does not fit the unit 'm'"),
        ({"limit": "1 um"}, "limit: plant.rotation.x: 'um' does not fit the unit 'rad'"),
        ({"window": "15 ms"}, "window: 0.015 s is not a whole number of steps of 0.01 s"),
        ({"window": "11 s"}, "window: one value of RPE needs 11 s; the run has 10 s"),
        ({"settling": "9.5 s"}, "window: one value of RPE needs 1 s after 9.5 s of settling; the run has 10 s"),
        ({"settling": "10 s"}, "settling: 10 s are all of the run of 10 s"),
        ({"index": "PDE", "at": None, "separation": "15 ms"}, "separation: 0.015 s is not a whole number"),
        ({"index": "PDE", "at": None, "separation": "9.5 s"}, "window: one value of PDE needs 10.5 s"),
    ],
)
def test_requirements_that_do_not_fit_the_run(require, change, problem):
    with pytest.raises(RequirementError) as refused:
        RequirementRecord(require(**change), COLUMNS, STEP, 1001)
    assert f"requirement[0] (blur), {problem}" in str(refused.value)


def test_the_settling_begins_where_the_lead_in_ends(require, white):
    """A disturbance that rises is no part of what is judged, and no part of the settling."""
    rows = white(1001)
    rows[:400] = 1e9
    rows[400:500] = 1e6
    requirement = require(index="APE", at=None, window=None, settling="1 s")
    record = RequirementRecord(requirement, COLUMNS, STEP, len(rows), lead_s=4.0)
    record.block(0, np.arange(1001) * STEP, rows)
    assert record.distributions[0].count == record.rows == 501
    assert record.distributions[0].peak == np.abs(rows[500:, 0]).max()
    with pytest.raises(RequirementError, match=r"window: .* needs 6 s after 1 s of settling; the run has 6"):
        RequirementRecord(require(settling="1 s", window="6 s"), COLUMNS, STEP, 1001, lead_s=4.0)


def test_a_window_of_the_whole_run(require, white):
    (found,) = observe(require(window="10 s"), white(1001)).distributions
    assert found.count == 1000
