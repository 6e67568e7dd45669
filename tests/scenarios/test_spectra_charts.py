"""Spectra of the settled part of a transient: what is shown is what was in the rows."""

from types import SimpleNamespace

import numpy as np
import pytest

from ps_fmu.scenarios import pointing_exploration as pointing
from ps_fmu.scenarios.spectra_charts import FEWEST_ROWS, chart_settled

STEP, LINE_HZ, AMPLITUDE = 0.01, 5.0, 1e-6
NAMES = ("x", "y")
TIME = STEP * np.arange(4096)


def shake(drift=0.0):
    """Rows (n, 2) with a line, and a drift that is no part of the spectrum."""
    line = AMPLITUDE * np.sin(2.0 * np.pi * LINE_HZ * TIME) + drift * TIME
    return np.column_stack([line, 0.5 * line])


def test_a_line_and_its_rms_without_the_drift():
    cases = (("off", "passive", shake(1e-6)), ("on", "active", 0.1 * shake()))
    (group,) = chart_settled("error", NAMES, (10.0, 50.0), cases, STEP)
    assert group.title == "Spectra of the settled part: error" and "From 10 to 50 s" in group.caption
    assert [chart.title for chart in group.charts] == [
        "x, PSD", "y, PSD", "x, RMS below frequency", "y, RMS below frequency",
    ]  # fmt: skip
    for chart, scale in zip(group.charts, (1.0, 0.5, 1.0, 0.5), strict=True):
        off, on = chart.curves
        if chart.title.endswith("PSD"):
            assert group.axis.values[np.nanargmax(off.low)] == pytest.approx(LINE_HZ, rel=0.02)
            continue
        rms = scale * AMPLITUDE / np.sqrt(2.0)
        assert off.low[-1] == pytest.approx(rms, rel=0.02)
        assert on.low[-1] == pytest.approx(0.1 * rms, rel=0.02)


def test_what_the_rows_have_filtered_away_is_not_drawn():
    (group,) = chart_settled("error", NAMES, (0.0, 41.0), [("on", "active", shake())], STEP, highest_hz=8.0)
    assert group.axis.values[-1] <= 8.0
    assert "filtered to 8 Hz" in group.caption


@pytest.mark.parametrize("values", [np.zeros((100, 2)), shake()[: FEWEST_ROWS - 1]])
def test_what_is_at_rest_or_too_short_has_no_spectrum(values):
    assert chart_settled("error", NAMES, (0.0, 1.0), [("on", "active", values)], STEP) == []


def test_the_pointing_error_is_taken_while_the_loop_is_locked():
    """The rows of the phase, and no others; without that phase there is no spectrum."""
    quiet = shake()
    late = TIME >= 20.0
    record = SimpleNamespace(
        time=TIME,
        error=np.column_stack([np.where(late, value, 1.0) for value in (*quiet.T, quiet[:, 0])]),
        span=lambda first, last: (first <= TIME) & (last > TIME),
        phases=lambda: {"locked": (20.0, 40.0)},
    )
    (group,) = pointing._chart_settled(SimpleNamespace(off=record, on=record))
    assert group.title == "Spectra of the settled part: error while the loop is locked, axes of P"
    assert len(group.charts) == 6
    assert group.charts[3].curves[0].low[-1] == pytest.approx(AMPLITUDE / np.sqrt(2.0), rel=0.02)
    record.phases = dict
    assert pointing._chart_settled(SimpleNamespace(off=record, on=record)) == []
