from dataclasses import dataclass

import numpy as np
import pytest

from ps_fmu.scenarios.jitter import IMAGE_POINT, ROTATION, Jitter


@dataclass(frozen=True)
class Column:
    name: str
    unit: str


COLUMNS = [Column("plant.orientation.roll", "rad"), *(Column(name, "rad") for name in ROTATION)]
COLUMNS += [Column(name, "m") for name in IMAGE_POINT]


def observed(steps, step=1e-3):
    values = np.random.default_rng(8).normal(0.0, 1e-6, (steps + 1, len(COLUMNS)))
    jitter = Jitter(COLUMNS, step_s=step, steps=steps)
    for first in range(0, steps + 1, 1000):
        block = values[first : first + 1000]
        for observer in jitter.observers:
            observer.block(first, np.arange(first, first + len(block)) * step, block)
    return jitter, values


def test_all_results_of_a_run():
    jitter, values = observed(5000)
    np.testing.assert_allclose(jitter.statistics.rms, np.sqrt((values[:, 1:4] ** 2).mean(axis=0)), rtol=1e-12)
    assert jitter.scatter.count == 5001
    assert jitter.envelope.names == ROTATION
    assert jitter.indices.windows == 5
    frequency, psd = jitter.spectrum
    assert frequency[1] == pytest.approx(1.0 / 2.048)
    np.testing.assert_allclose(psd.sum(axis=1) * frequency[1], values[:, 1:4].var(axis=0), rtol=0.1)


@pytest.mark.parametrize("steps", [1, 2, 7, 8, 100])
def test_short_runs_have_no_indices_and_perhaps_no_spectrum(steps):
    jitter, _ = observed(steps)
    assert jitter.statistics.count == steps + 1
    assert jitter.indices is None
    assert (jitter.spectrum is None) == (steps < 8)
