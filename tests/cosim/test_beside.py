"""Observers in a thread beside the loop see what they see without it, whatever ends the run."""

import os
import signal
import threading
from ctypes import c_int

import netCDF4
import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu.cosim import Column, Master, Recorder, RecorderError, SlaveError, UsageError
from ps_fmu.cosim.clock import StepClock
from ps_fmu.cosim.fmu_instance import InstancePhase
from ps_fmu.cosim.recording import beside
from ps_fmu.cosim.recording.beside import WAITING_BLOCKS, DeliveryBeside
from ps_fmu.cosim.rows import RowLayout, Rows

H = 0.01
LONGEST_S = 60.0  # that a test waits for another thread before it fails


def run(system, observers, duration=1.0, in_thread=True, block_rows=4):
    """Run the system; the master, and what was raised."""
    master = Master(system, H, block_rows=block_rows)
    caught = None
    try:
        with master:
            master.initialise()
            master.run(duration, observers, beside=in_thread)
    except BaseException as error:
        caught = error
    return master, caught


def is_running():
    return any(thread.name == "observers" for thread in threading.enumerate())


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


@pytest.mark.parametrize("in_thread", [True, False])
def test_an_observer_can_leave_out_blocks_without_large_values(oscillator, in_thread):
    every, largest, none = Growth(-1.0), Growth(0.0), Growth(np.inf)
    run(oscillator, [every], in_thread=in_thread)
    assert len(every.blocks) > 20
    peaks = [peak for _, peak in every.blocks]
    largest.ignored_magnitude = sorted(peaks)[-6]
    run(oscillator, [largest, none], in_thread=in_thread)
    assert largest.blocks == [one for one in every.blocks if one[1] > largest.ignored_magnitude]
    assert 0 < len(largest.blocks) <= 5
    assert not none.blocks


def test_blocks_are_the_same_and_come_from_another_thread(oscillator):
    class Where:
        def __init__(self):
            self.threads = set()

        def block(self, first_index, time, values):
            self.threads.add(threading.current_thread())

    where, found = Where(), []
    for in_thread in (False, True):
        collect = Collect()
        assert run(oscillator, [collect, where] if in_thread else [collect], 2.0, in_thread)[1] is None
        found.append(collect)
    plain, threaded = found
    assert plain.firsts == threaded.firsts
    assert len(plain.firsts) > 3 * WAITING_BLOCKS
    np.testing.assert_array_equal(plain.time, threaded.time)
    np.testing.assert_array_equal(plain.values, threaded.values)
    assert threading.main_thread() not in where.threads
    assert len(where.threads) == 1
    assert not is_running()


def test_integers_and_booleans_arrive_as_numbers_in_every_block(make_system):
    system = make_system({"counter": "ToyCounter"}, []).with_parameters({"counter.enabled": True})
    plain, threaded = Collect(), Collect()
    run(system, [plain], in_thread=False)
    run(system, [threaded])
    np.testing.assert_array_equal(plain.values, threaded.values)
    assert len(np.unique(plain.values[:, 1])) > 1 or len(np.unique(plain.values[:, 2])) > 1


def test_several_runs_and_events_continue_the_rows(make_system):
    found = []
    for in_thread in (False, True):
        collect = Collect()
        with Master(make_system({"gain": "ToyGain"}, []), H, block_rows=4) as master:
            master.initialise()
            for begin in (0.0, 0.1, 0.2):
                master.run(0.1, [collect], [(begin + 0.05, "gain.u", begin + 3.0)], beside=in_thread)
        found.append(collect)
    assert found[0].firsts == found[1].firsts
    np.testing.assert_array_equal(found[0].values, found[1].values)
    assert len(np.unique(found[0].values)) == 4


@pytest.mark.parametrize("block", [1, 2, 25])
def test_a_failing_observer_ends_the_run_as_without_the_thread(oscillator, block):
    """All observers end with the block in which one failed, and the message names its time."""
    ends = []
    for in_thread in (False, True):
        collect = Collect()
        master, error = run(oscillator, [Refusing(block), collect], in_thread=in_thread)
        assert type(error) is RecorderError
        assert master.phases["mass"] is InstancePhase.FREED
        ends.append((str(error), error.__notes__, len(collect.time), master.time))
    assert ends[0] == ends[1]
    assert ends[1][2] == min(4 * block, 101)
    assert not is_running()


def test_the_failure_of_an_observer_precedes_what_the_loop_met_later(make_system):
    """A failure in the first block counts, though the FMU has failed by the time that it is known."""
    system = make_system({"mass": "ToyMass", "clock": "ToyFailing"}, []).with_parameters({"clock.mode": "discard"})
    collect, failed = Collect(), Refusing(1)
    _, error = run(system, [failed, collect], block_rows=4)
    assert type(error) is RecorderError
    assert len(collect.time) == 4
    assert "stopped at t = 0.03 s" in error.__notes__[-1]


@pytest.mark.usefixtures("not_ended")
@pytest.mark.parametrize("mode", ["discard", "nan"])
def test_a_failing_fmu_keeps_its_rows_and_its_message(make_system, mode):
    system = make_system({"mass": "ToyMass", "clock": "ToyFailing"}, []).with_parameters({"clock.mode": mode})
    ends = []
    for in_thread in (False, True):
        collect = Collect()
        _, error = run(system, [Refusing(2), collect], in_thread=in_thread)
        assert isinstance(error, SlaveError)
        ends.append((str(error), error.__notes__, collect.time.tolist(), collect.values.tolist()))
    assert ends[0] == ends[1]
    assert any("Refusing failed, too: no space" in note for note in ends[1][1])
    assert len(ends[1][2]) == 6


def test_ctrl_c_keeps_all_complete_rows(make_system):
    collect = Collect()
    _, error = run(make_system({"clock": "ToyInterrupting"}, []), [collect])
    assert isinstance(error, KeyboardInterrupt)
    np.testing.assert_allclose(collect.time, np.arange(7) * H)
    assert not is_running()


def test_ctrl_c_while_the_observers_are_behind_keeps_what_was_computed(oscillator):
    before = signal.getsignal(signal.SIGINT)

    class Pressing:
        def block(self, first_index, time, values):
            if first_index == 8:
                os.kill(os.getpid(), signal.SIGINT)

    collect = Collect()
    master, error = run(oscillator, [Pressing(), collect], 20.0)
    assert isinstance(error, KeyboardInterrupt)
    assert 12 <= len(collect.time) <= 2000
    np.testing.assert_array_equal(collect.time, master.clock.times(0, len(collect.time)))
    assert f"stopped at t = {collect.time[-1]:.9g} s" in error.__notes__[-1]
    assert signal.getsignal(signal.SIGINT) is before


def test_the_loop_waits_for_observers_that_are_slower(oscillator):
    """Memory is bounded: no more blocks are on their way than there are."""
    ahead = []

    class Watching(Collect):
        def block(self, first_index, time, values):
            super().block(first_index, time, values)
            ahead.append((master.time - time[-1]) / H)

    watching = Watching()
    master = Master(oscillator, H, block_rows=4)
    with master:
        master.initialise()
        master.run(5.0, [watching], beside=True)
    assert len(watching.time) == 501
    assert max(ahead) <= 4 * (WAITING_BLOCKS + 2)


def test_a_run_is_refused_as_before(oscillator):
    with Master(oscillator, H) as master:
        master.initialise()
        with pytest.raises(UsageError, match="duration"):
            master.run(-1.0, [], beside=True)
    assert not is_running()


class Storing:
    """Observer that takes early rows; ``came`` is set when it has some, or has been asked ``asked`` times."""

    def __init__(self, error=None):
        self.came, self.first, self.values, self.error = threading.Event(), None, None, error

    def block(self, first_index, time, values):
        pass

    def early(self, first_index, time, values):
        if len(values) < 3:
            return
        self.first, self.values = first_index, values
        self.came.set()
        if self.error is not None:
            raise self.error


@pytest.fixture
def hanging(monkeypatch):
    """A delivery whose block has 3 of 5 rows, as when an FMU hangs in the next step; (rows, storing, delivery)."""
    monkeypatch.setattr(beside, "EARLY_S", 0.01)
    made = []

    def make(bad_row=None, error=None):
        columns = tuple(Column(name, "1", "Real", "") for name in ("a.x", "a.y"))
        rows, storing = Rows(RowLayout(columns, {}, {}), 5), Storing(error)
        rows._n_real = 2
        rows.block[:3] = np.arange(6.0).reshape(3, 2)
        if bad_row is not None:
            rows.block[bad_row] = np.nan
        rows.filled = 3
        made.append(DeliveryBeside(rows, StepClock(0.0, H), columns, [storing], lambda: rows.filled))
        return rows, storing, made[-1]

    yield make
    for delivery in made:
        delivery.close()


def test_rows_of_an_unfinished_block_are_stored_when_nothing_comes(hanging):
    rows, storing, _ = hanging()
    assert storing.came.wait(LONGEST_S)
    assert storing.first == 0
    np.testing.assert_array_equal(storing.values, np.arange(6.0).reshape(3, 2))
    assert rows.filled == 3


def test_a_failure_to_store_early_ends_the_run(hanging):
    _, storing, delivery = hanging(error=RecorderError("no space"))
    assert storing.came.wait(LONGEST_S)
    with pytest.raises(RecorderError, match="no space"):
        delivery.wait()
    assert delivery.failed_at == 0  # no block was taken


def test_rows_are_not_stored_early_before_those_that_are_on_their_way(hanging):
    """The loop has gone on to the next block, and the last one has not arrived."""
    rows, storing, delivery = hanging()
    delivery.close()
    storing.first, rows.first_index = None, 5
    delivery._serve_early()
    assert storing.first is None
    rows.first_index = 0
    delivery._serve_early()
    assert storing.first == 0


def test_a_loop_counts_its_rows_for_another_thread(oscillator):
    with Master(oscillator, H, block_rows=50) as master:
        master.initialise()
        assert master.loop.count_rows() == 1
        master.loop.advance(master.clock.times(0, 20), c_int())
        assert master.loop.count_rows() == master.rows.filled == 21


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
