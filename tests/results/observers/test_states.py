"""An observer that goes on from a state has the result of one that has seen all, to the last bit."""

from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from ps_fmu.cosim.checkpoint.files import read_file, write_file
from ps_fmu.cosim.checkpoint.state import Stateful
from ps_fmu.cosim.rows import Column
from ps_fmu.requirements.record import RequirementRecord
from ps_fmu.requirements.requirement import read_requirements
from ps_fmu.results.observers.bins import EnvelopeObserver, MeanObserver
from ps_fmu.results.observers.observer import Batch
from ps_fmu.results.observers.sampler import HistoryObserver, LastRow, SampleObserver
from ps_fmu.results.observers.scatter import ScatterObserver
from ps_fmu.results.observers.statistics import ArrivalObserver, DriftObserver, Statistics
from ps_fmu.results.observers.welch import Welch
from ps_fmu.runs.index_record import IndexRecord

STEP, ROWS, BLOCK = 1e-3, 1000, 70
ALL = ("a.x", "a.y", "b.u", "b.v")
POINTS = ("b.u", "b.v")
REQUIREMENTS = """
[[requirement]]
name = "jitter"
signal = "b.u"
index = "jitter"
window = "150 ms"
statistic = "rms"
confidence = 0.9
limit = "1 m"
"""


def require(columns, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(REQUIREMENTS)
    recorded = [Column(column.name, column.unit, "Real", "") for column in columns]
    return RequirementRecord(read_requirements(path)[0], recorded, STEP, ROWS)


MAKERS = {
    "statistics": lambda columns, _: Statistics(columns, ALL, start_s=0.05),
    "drift": lambda columns, _: DriftObserver(columns, ALL, start_s=0.0, end_s=0.9),
    "envelope": lambda columns, _: EnvelopeObserver(columns, ALL, bins=60),
    "means": lambda columns, _: MeanObserver(columns, ALL, bins=60),
    "history": lambda columns, _: HistoryObserver(columns, ALL),
    "sampler": lambda columns, _: SampleObserver(columns, ALL, [990, 3, 500, 77]),
    "scatter": lambda columns, _: ScatterObserver(columns, POINTS, sample=50),
    "welch": lambda columns, _: Welch(columns, ALL, segment_s=0.128, step_s=STEP),
    "last": lambda columns, _: LastRow(columns, ALL),
    "arrival": lambda columns, _: ArrivalObserver(columns, ALL[1:], flag="a.x", settle_s=0.2),
    "batch": lambda columns, _: Batch(columns, [Statistics(columns, POINTS), EnvelopeObserver(columns, ALL, bins=60)]),
    "indices": lambda columns, _: IndexRecord(columns, ALL, step_s=STEP, rows=ROWS, window_s=0.05),
    "requirement": require,
}


def conclude(observer):
    """The result as something that can be compared."""
    if isinstance(observer, SampleObserver):
        return plain(observer.values(*ALL))
    if isinstance(observer, Batch):
        return plain([member.result() for member in observer._members])
    if isinstance(observer, Welch):
        return plain([observer.psd(), observer.segments])
    if isinstance(observer, RequirementRecord):
        (found,) = observer.distributions
        return plain([observer.judged_s, found.rms, found.peak, found.counts, found.state_rms(0.9)])
    if isinstance(observer, IndexRecord):
        return plain([(one.index, one.count, one.bias, one.rms, one.peak, one.quantiles) for one in observer.result()])
    return plain(observer.result())


def plain(value):
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if is_dataclass(value):
        return [plain(getattr(value, field.name)) for field in fields(value)]
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


def observe(observer, values, first, last):
    for begin in range(first, last, BLOCK):
        end = min(begin + BLOCK, last)
        observer.block(begin, np.arange(begin, end) * STEP, values[begin:end].copy())


@pytest.fixture(scope="module")
def values():
    rng = np.random.default_rng(8)
    found = rng.normal(size=(ROWS, 4)) * 1e-3
    found[:, 0] = (np.arange(ROWS) > 300) & (np.arange(ROWS) < 450)  # something moves
    return found


@pytest.mark.parametrize("cut", [0, 3 * BLOCK, 6 * BLOCK, 11 * BLOCK])
@pytest.mark.parametrize("name", MAKERS)
def test_it_goes_on_from_a_state(columns, values, tmp_path, name, cut):
    whole, first, second = (MAKERS[name](columns, tmp_path) for _ in range(3))
    assert isinstance(first, Stateful)
    observe(whole, values, 0, ROWS)
    observe(first, values, 0, cut)
    write_file(tmp_path / "state.zip", dict(first.save_state()))
    observe(first, values, cut, ROWS)  # what comes later is not in the state
    second.load_state(read_file(tmp_path / "state.zip"))
    observe(second, values, cut, ROWS)
    assert conclude(second) == conclude(whole)


@pytest.mark.parametrize("name", MAKERS)
def test_a_state_that_does_not_fit_is_refused(columns, values, tmp_path, name):
    observer = MAKERS[name](columns, tmp_path)
    observe(observer, values, 0, 3 * BLOCK)
    state = observer.save_state()
    for key, value in state.items():
        wrong = np.zeros((2, 2, 2)) if isinstance(value, np.ndarray) else object()
        with pytest.raises((ValueError, KeyError, TypeError)):
            MAKERS[name](columns, tmp_path).load_state({**state, key: wrong})
        with pytest.raises(KeyError):
            MAKERS[name](columns, tmp_path).load_state({k: v for k, v in state.items() if k != key})
