from dataclasses import dataclass

import numpy as np
import pytest

from ps_fmu.scenarios.jitter_record import IMAGE_POINT, ORIENTATION, REACHABLE, ROTATION, SATURATED, JitterRecord


@dataclass(frozen=True)
class Column:
    name: str
    unit: str


COLUMNS = [Column(name, "rad") for name in (*ORIENTATION, *ROTATION)]
COLUMNS += [Column(name, "m") for name in IMAGE_POINT] + [Column(name, "1") for name in (REACHABLE, SATURATED)]
PLACES = slice(3, 6)  # of the rotation


def samples(steps):
    values = np.random.default_rng(8).normal(0.0, 1e-6, (steps + 1, len(COLUMNS)))
    values[:, :3], values[:, -2:] = (0.1, 0.2, 0.3), (1.0, 0.0)
    return values


def observed(values, step=1e-3, **others):
    jitter = JitterRecord(COLUMNS, step_s=step, steps=len(values) - 1, **others)
    for first in range(0, len(values), 1000):
        block = values[first : first + 1000]
        for observer in jitter.observers:
            observer.block(first, np.arange(first, first + len(block)) * step, block)
    return jitter


def test_all_results_of_a_run():
    values = samples(5000)
    jitter = observed(values)
    rotation = values[:, PLACES]
    np.testing.assert_allclose(jitter.statistics.rms, np.sqrt((rotation**2).mean(axis=0)), rtol=1e-12)
    assert jitter.scatter.count == 5001
    assert jitter.envelope.names == ROTATION
    frequency, psd = jitter.spectrum
    assert frequency[1] == pytest.approx(1.0 / 2.048)
    np.testing.assert_allclose(psd.sum(axis=1) * frequency[1], rotation.var(axis=0), rtol=0.1)
    np.testing.assert_array_equal(jitter.orientation, (0.1, 0.2, 0.3))
    assert jitter.reachable


def test_a_lead_in_is_left_out_of_all_but_the_envelope():
    values = samples(5000)
    values[:2001, PLACES] += 1.0
    values[:2001, -1] = 1.0
    jitter = observed(values, lead_steps=2000)
    rotation = values[2001:, PLACES]
    assert (jitter.statistics.count, jitter.scatter.count) == (3000, 3000)
    assert jitter.saturated == 0.0
    np.testing.assert_allclose(jitter.statistics.rms, np.sqrt((rotation**2).mean(axis=0)), rtol=1e-12)
    assert jitter.spectrum[1].max() < 1e-6
    assert jitter.envelope.time[0] == 0.0
    assert jitter.envelope.high.max() > 0.9


def test_drift_after_the_lead_in():
    """1e-6 rad/s over 3 s: the middles of the halves are 1.5 s apart."""
    values = samples(5000)
    values[:, PLACES] = np.arange(5001)[:, None] * 1e-9
    np.testing.assert_allclose(observed(values, lead_steps=2000).drift, 1.5e-6, rtol=1e-3)
    assert np.isnan(observed(samples(1)).drift).all()


def test_flags_of_commander_and_isolator():
    values = samples(100)
    values[60:, -2], values[:25, -1] = 0.0, 1.0
    jitter = observed(values)
    assert not jitter.reachable
    assert jitter.saturated == pytest.approx(25 / 101)


@pytest.mark.parametrize("steps", [1, 2, 7, 8, 100])
def test_short_runs_have_perhaps_no_spectrum(steps):
    jitter = observed(samples(steps))
    assert jitter.statistics.count == steps + 1
    assert (jitter.spectrum is None) == (steps < 8)


def test_an_explored_run_keeps_a_finer_envelope():
    values = samples(20_000)
    plain, explored = observed(values), observed(values, explored=True)
    assert len(explored.envelope.time) == 20_001
    assert len(plain.envelope.time) < 3001


def test_the_whole_history_where_it_is_asked_for():
    values = samples(2500)
    np.testing.assert_array_equal(observed(values, history=True).rotation, values[:, PLACES].T)
    with pytest.raises(ValueError, match="the history was not kept"):
        _ = observed(values).rotation
