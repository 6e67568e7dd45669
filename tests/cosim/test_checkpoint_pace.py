"""Checkpoints wait until the last one has been paid for; without a share they come when they are due."""

import signal
from itertools import count

import pytest
from support.checkpoints import STEPS, H, Keep, check_same, run

from ps_fmu.cosim import Master, UsageError
from ps_fmu.cosim.checkpoint.checkpoints import LOOK_S, Checkpoints, Pace
from ps_fmu.cosim.checkpoint.files import CheckpointFolder


class Clock:
    """Shows the time that it was set to [s]."""

    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def written(monkeypatch):
    """The communication points of the checkpoints that are written, in their order."""
    original, found = CheckpointFolder.write, []

    def write(self, index, tree):
        found.append(index)
        return original(self, index, tree)

    monkeypatch.setattr(CheckpointFolder, "write", write)
    return found


def take(pace, clock, rows_s=0.0):
    """A checkpoint that takes 0.4 s; when it began."""
    with pace.count(rows_s):
        clock.now += 0.4
    return clock.now - 0.4


def test_the_first_one_does_not_wait(clock):
    assert Pace(1e-9, clock).is_paid(1e9)


def test_one_is_paid_for_by_the_time_since_it_began(clock):
    pace = Pace(0.02, clock)
    began = take(pace, clock)
    for since, paid in ((19.99, False), (20.01, True), (1000.0, True)):
        clock.now = began + since
        assert pace.is_paid(0.0) is paid


def test_rows_of_journals_count_but_leave_a_quarter(clock):
    pace = Pace(0.02, clock)
    began = take(pace, clock, rows_s=7.0)
    clock.now = began + 30.0
    assert pace.is_paid(7.19)
    assert not pace.is_paid(7.21)
    clock.now = began + 79.9
    assert not pace.is_paid(50.0)
    clock.now = began + 80.1
    assert pace.is_paid(50.0)


def test_without_a_share_none_waits(clock):
    pace = Pace(None, clock)
    take(pace, clock)
    assert pace.is_paid(1e9)


def test_one_that_waits_is_not_looked_at_too_often(clock):
    pace = Pace(0.02, clock)
    pace.start(500)
    clock.now += 0.5
    assert pace.find_next_look(50_500) == 50_500 + 50_000 * LOOK_S / 0.5
    clock.now += 1e9
    assert pace.find_next_look(50_500) == 50_501
    pace.start(0)
    assert pace.find_next_look(7) == 8  # no time has passed


@pytest.mark.parametrize("share", [0.0, -0.02, float("nan")])
def test_an_impossible_share_is_refused(tmp_path, share):
    with pytest.raises(UsageError, match="expected a share of the time above 0"):
        Checkpoints(tmp_path, 1.0, share=share)


def test_without_a_share_they_come_when_they_are_due(mixed, tmp_path, written):
    run(mixed, Checkpoints(tmp_path, 0.1))
    assert written == [10, 20, 30, 40, 50, 60]


def test_where_none_can_be_paid_the_first_and_the_last_are_taken(mixed, tmp_path, written):
    """Results are those of a run without checkpoints, and the last one is at the end of the run."""
    check_same(run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9)), run(mixed))
    assert written == [5, STEPS]
    again = run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9, resume=True))
    check_same(again, run(mixed))


def test_a_run_that_is_killed_while_one_waits_goes_on(mixed, tmp_path, written):
    run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9), stop_s=0.4)
    assert written == [5]
    check_same(run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9, resume=True)), run(mixed))
    assert written == [5, 10, STEPS]  # the first one of that run does not wait


def test_one_that_waits_is_taken_at_a_multiple_of_the_interval(mixed, tmp_path, written, monkeypatch):
    """By a clock that goes on by 1 s whenever it is read: a checkpoint takes 1 s, to look at one takes 1 s."""
    ticks = count(1.0)
    module = "ps_fmu.cosim.checkpoint.checkpoints.Pace"
    monkeypatch.setattr(module, lambda share: Pace(share, lambda: next(ticks)))
    run(mixed, Checkpoints(tmp_path, 2 * H, share=0.1))
    assert written == [2, 12, 22, 32, 42, 52, STEPS]


def test_ctrl_c_does_not_wait(mixed, tmp_path, written):
    def press(simulated, _wall, _factor):
        if simulated >= 0.26 and not pressed:
            pressed.append(simulated)
            signal.raise_signal(signal.SIGINT)

    pressed, keep = [], Keep()
    with pytest.raises(KeyboardInterrupt), Master(mixed, H, block_rows=7) as master:
        master.initialise()
        master.run(STEPS * H, [keep], (), press, checkpoints=Checkpoints(tmp_path, 0.1, share=1e-9))
    assert written == [10, len(keep.time) - 1]
    assert written[1] < STEPS
