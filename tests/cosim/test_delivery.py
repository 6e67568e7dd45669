"""What observers get, whatever ends the run."""

import netCDF4
import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu.cosim import Column, Master, Recorder, RecorderError
from ps_fmu.cosim.fmu_instance import InstancePhase
from ps_fmu.cosim.recording import delivery

H = 0.01


def run(system, observers, duration=1.0, block_rows=4):
    """Run the system; the master, and what was raised."""
    master = Master(system, H, block_rows=block_rows)
    caught = None
    try:
        with master:
            master.initialise()
            master.run(duration, observers)
    except BaseException as error:
        caught = error
    return master, caught


class Refusing:
    """Observer that fails in its n-th block."""

    def __init__(self, n):
        self.left = n

    def block(self, first_index, time, values):
        self.left -= 1
        if self.left == 0:
            raise RecorderError("no space")


class Growth:
    """Observer that gets blocks in which a value is beyond a limit."""

    def __init__(self, limit):
        self.ignored_magnitude = limit
        self.blocks = []

    def block(self, first_index, time, values):
        self.blocks.append((first_index, np.abs(values).max()))


def test_an_observer_can_leave_out_blocks_without_large_values(oscillator):
    every, largest, none = Growth(-1.0), Growth(0.0), Growth(np.inf)
    run(oscillator, [every])
    assert len(every.blocks) > 20
    peaks = [peak for _, peak in every.blocks]
    largest.ignored_magnitude = sorted(peaks)[-6]
    run(oscillator, [largest, none])
    assert largest.blocks == [one for one in every.blocks if one[1] > largest.ignored_magnitude]
    assert 0 < len(largest.blocks) <= 5
    assert not none.blocks


@pytest.mark.parametrize("block", [1, 2, 25])
def test_all_observers_end_with_the_block_in_which_one_failed(oscillator, block):
    collect = Collect()
    master, error = run(oscillator, [Refusing(block), collect])
    assert type(error) is RecorderError
    assert master.phases["mass"] is InstancePhase.FREED
    assert len(collect.time) == min(4 * block, 101)
    assert f"stopped at t = {collect.time[-1]:.9g} s" in error.__notes__[-1]


class Storing(Collect):
    """Observer that takes early rows."""

    def __init__(self, error=None):
        super().__init__()
        self.seen, self.error = [], error

    def early(self, first_index, time, values):
        if self.error is not None:
            raise self.error
        self.seen.append((first_index, time.copy(), values.copy()))


def test_rows_of_an_unfinished_block_are_stored_when_a_block_takes_long(make_system, monkeypatch):
    monkeypatch.setattr(delivery, "EARLY_S", 0.0)
    system = make_system({"counter": "ToyCounter"}, []).with_parameters({"counter.enabled": True})
    storing, plain = Storing(), Collect()
    with Master(system, H, block_rows=4) as master:
        master.initialise()
        for _ in range(3):
            master.run(0.02, [storing, plain], [(master.time + H, "counter.increment", 2)])
    assert storing.values.tobytes() == plain.values.tobytes()  # whole numbers are made of C ints once
    assert {first for first, *_ in storing.seen} <= {0, 3, 5}
    for first, time, values in storing.seen:
        np.testing.assert_array_equal(time, plain.time[first : first + len(time)])
        np.testing.assert_array_equal(values, plain.values[first : first + len(time)])


def test_a_failure_to_store_early_ends_the_run(make_system, monkeypatch):
    monkeypatch.setattr(delivery, "EARLY_S", 0.0)
    events = [(0.02, "gain.u", 1.0)]
    with pytest.raises(RecorderError, match="no space"), Master(make_system({"gain": "ToyGain"}, []), H) as master:
        master.initialise()
        master.run(0.1, [Storing(RecorderError("no space"))], events)


def test_a_recorder_stores_early_rows_once(tmp_path):
    values = np.random.default_rng(3).standard_normal((40, 1))
    time = np.arange(40) * H
    for factor in (1, 3):
        stored = []
        for early in ((), (2, 2, 5), (10,)):  # rows of the second block that are complete when nothing comes
            path = tmp_path / "r.nc"
            with Recorder(
                path, "run", columns=[Column("a.x", "1", "Real", "")], step=H, storage_step=factor * H
            ) as recorder:
                recorder.block(0, time[:10], values[:10])
                for count in early:
                    recorder.early(10, time[10 : 10 + count], values[10 : 10 + count])
                    if factor == 1:
                        recorder._dataset.sync()
                        with netCDF4.Dataset(path) as data:
                            assert len(data["run"]["time"]) == 10 + count
                recorder.block(10, time[10:20], values[10:20])
                recorder.early(20, time[20:20], values[20:20])
                recorder.block(20, time[20:], values[20:])
            with netCDF4.Dataset(path) as data:
                stored.append((data["run"]["time"][:].tolist(), data["run"]["a.x"][:].tolist()))
        assert stored[0] == stored[1] == stored[2]
        np.testing.assert_array_equal(stored[0][0], time[::factor])
