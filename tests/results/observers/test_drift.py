from dataclasses import dataclass

import numpy as np
import pytest

from ps_fmu.results.observers.drift import DriftObserver


@dataclass(frozen=True)
class Column:
    name: str
    unit: str


COLUMNS = [Column("a", "rad"), Column("b", "m")]
TIME = np.arange(12_001) * 0.01  # to 120 s


def drift(a, b, block=1000):
    observer = DriftObserver(COLUMNS, ["b", "a"], start_s=20.0, end_s=120.0)
    values = np.column_stack(np.broadcast_arrays(a, b, TIME)[:2])
    for first in range(0, len(TIME), block):
        observer.block(first, TIME[first : first + block], values[first : first + block])
    return observer.result()


def test_a_steady_change_is_found_and_an_offset_is_not():
    """1e-6 per s: the middles of the halves are 50 s apart."""
    np.testing.assert_allclose(drift(1e-6 * TIME, 3.0), [0.0, 5e-5], atol=1e-12)


@pytest.mark.parametrize("frequency", [0.1, 0.105, 0.25, 5.0])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0])
def test_lines_of_the_noise_hardly_count(frequency, phase):
    """Five cycles in a half: each half keeps 1/(5 pi 24) of the amplitude at most; plain means keep 1/(5 pi)."""
    line = np.sin(2.0 * np.pi * frequency * TIME + phase)
    assert abs(drift(line, 0.0)[1]) < 2.0 / (np.pi * 5.0 * 24.0)


def test_rows_outside_the_window_and_the_cut_into_blocks_do_not_matter():
    signal = np.random.default_rng(3).normal(size=len(TIME))
    disturbed = np.where(TIME <= 20.0, 1e3, signal)
    np.testing.assert_allclose(drift(disturbed, 0.0, block=77), drift(signal, 0.0), rtol=1e-9, atol=1e-15)


def test_without_rows_in_both_halves_it_is_not_known():
    observer = DriftObserver(COLUMNS, ["a"], start_s=0.0, end_s=100.0)
    observer.block(0, TIME[:100], np.zeros((100, 2)))
    assert np.isnan(observer.result()).all()
    with pytest.raises(ValueError, match="window: expected an end after its start"):
        DriftObserver(COLUMNS, ["a"], start_s=1.0, end_s=1.0)
