"""Steps: maps, events, tables, times; refused steps change nothing."""

import math

import numpy as np
import pytest
from support.states import start_stepping

from ps_fmu import native
from ps_fmu.slavekit.author import core
from ps_fmu.slavekit.author.guard import FmuError, ModelError, Refused

H = 0.01  # s


def run(slave, n, h=H, start=0.0, first=0):
    rows = []
    for i in range(first, first + n):
        assert slave.do_step(start + i * h, h)
        rows.append(slave.y.tolist())
    return np.array(rows)


def everything(slave):
    state = slave._get_fmu_state()
    return state.buffer.tolist(), state.clock


def test_a_step_is_one_product(make, put):
    slave = make("oscillator")
    put(slave, force=3.0)
    for i in range(50):
        expected = slave.step_map(H) @ np.concatenate([slave.x, slave.u, slave.a])
        assert slave.do_step(i * H, H)
        np.testing.assert_allclose(np.concatenate([slave.y, slave.x]), expected, rtol=1e-14, atol=1e-15)


def test_maps_are_made_once_per_step_size(make):
    slave = make("oscillator")
    t = 0.0
    for i in range(40):
        h = (0.01, 0.02)[i % 2] * (1 + 1e-9 * (i % 3))  # hosts form step sizes with rounding
        assert slave.do_step(t, h)
        t += h
    assert slave.maps_made == 2
    for i in range(1, 40):
        assert slave.do_step(t, i * 0.001)
        t += i * 0.001
    assert len(slave._maps) <= 8


def test_hosts_that_add_up_times_are_followed(make):
    slave = make("waves")
    t = 0.0
    for _ in range(20000):
        assert slave.do_step(t, 1e-4)
        t += 1e-4
    assert abs(slave.y[1] - 2.0) < 1e-12  # the model's own time has not collected rounding
    assert slave._get_fmu_state().clock.origin == 0.0


@pytest.mark.parametrize("start", [1.4e9, -1.4e9])  # a UNIX time: its last place is 2.4e-7 s, more than 1e-3 of a step
def test_start_times_far_from_zero(toys, start):
    h, n = 1e-4, 3000
    slave, usual = (toys["waves"](instance_name="w") for _ in range(2))
    for instance, begin in ((slave, start), (usual, 0.0)):
        start_stepping(instance, begin, begin + n * h)
    for i in range(n):
        assert slave.do_step(start + i * h, h)
        assert usual.do_step(i * h, h)
    assert slave._get_fmu_state().clock.origin == start  # all in one count of steps
    with pytest.raises(Refused, match="ends beyond the stop time"):
        slave.do_step(start + n * h, h)


def test_a_host_that_drifts_off_the_grid_is_followed_too(make):
    slave = make("waves")
    t = 0.0
    for _ in range(3000):
        h = 1e-3 * (1 + 9e-7)  # taken for 1e-3
        assert slave.do_step(t, h)
        t += h
    assert abs(slave.y[1] - t) <= 1.1e-3 * 1e-3


def test_a_host_that_drifts_is_followed_through_steps_with_events(make, put):
    slave = make("oscillator")
    t = 0.0
    for i in range(3000):
        put(slave, reference=1e-3 * (1 + i % 2))
        h = 1e-3 * (1 + 9e-7)  # taken for 1e-3
        assert slave.do_step(t, h)
        assert abs(slave.event_times[-1] - t) <= 1.1e-3 * 1e-3
        t += h
    assert len(slave.event_times) == 3000


@pytest.mark.parametrize(
    ("time", "step", "problem"),
    [
        (0.02, 0.0, "step size 0.0 s"),
        (0.02, -0.01, "step size -0.01 s"),
        (0.02, math.nan, "step size nan s"),
        (0.02, math.inf, "step size inf s"),
        (0.03, 0.01, "current time 0.03 s: expected 0.02 s"),
        (0.0, 0.01, "current time 0.0 s: expected 0.02 s"),
        (math.nan, 0.01, "current time nan s"),
        (0.02, 200.0, "ends beyond the stop time 100.0 s"),
    ],
)
def test_impossible_steps_are_refused_and_change_nothing(toys, time, step, problem):
    slave = toys["oscillator"](instance_name="o")
    start_stepping(slave, 0.0, 100.0)
    run(slave, 2)
    before = everything(slave)
    with pytest.raises(Refused, match=f"^step from t = 0.02 s refused: .*{problem}"):
        slave.do_step(time, step)
    assert everything(slave) == before
    run(slave, 5, first=2)


def test_a_host_is_told_in_one_line_why_a_step_is_refused(make, put, capfd):
    slave = make("oscillator")
    slave.hosted = True
    put(slave, reference=1.5)
    with pytest.raises(FmuError) as error:
        slave.do_step(0.0, H)
    expected = "Oscillator 'oscillator': step from t = 0 s refused: reference = 1.5 m: expected at most 1 m"
    assert repr(error.value) == expected
    assert capfd.readouterr().err == f"{expected}\n"
    assert slave.log_queue == []


def test_the_last_step_may_end_at_the_stop_time_with_rounding(toys):
    slave = toys["oscillator"](instance_name="o")
    start_stepping(slave, 0.0, 1.0)
    t = 0.0
    for _ in range(10):
        assert slave.do_step(t, 0.1)
        t += 0.1
    with pytest.raises(Refused, match="ends beyond the stop time"):
        slave.do_step(t, 0.1)


def test_no_step_before_initialisation(make):
    slave = make("oscillator", until="initialisation")
    with pytest.raises(Refused, match="phase initialisation"):
        slave.do_step(0.0, H)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_result_that_is_not_finite_is_refused(make, put):
    slave = make("oscillator")
    run(slave, 3)
    put(slave, load=1e306)
    slave.x[1] = 1.7e308
    before = everything(slave)
    for _ in range(2):
        with pytest.raises(ModelError, match="not finite: position, speed"):
            slave.do_step(0.03, 1e3)
        assert everything(slave)[0] == before[0]
    slave.x[1] = 0.0
    assert slave.do_step(0.03, H)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_large_but_finite_results_pass(make, put):
    slave = make("oscillator")
    put(slave, load=1e200)
    run(slave, 3)
    assert abs(slave.y[1]) > 1e190


def test_an_event_comes_before_the_next_step_and_again_as_long_as_it_asks(make, put):
    slave = make("oscillator")
    run(slave, 2)
    put(slave, reference=0.25)
    run(slave, 5, first=2)
    assert slave.event_times == pytest.approx([2 * H, 3 * H, 4 * H], abs=0)
    assert slave.a[0] == 0.25
    put(slave, engage=False)
    run(slave, 5, first=7)
    assert len(slave.event_times) == 6
    assert not slave.y[2]


def test_an_event_that_fails_stays_due_and_leaves_no_trace(make, put):
    slave = make("oscillator")
    run(slave, 2)
    put(slave, reference=1.5)
    before = everything(slave)
    for n in (1, 2):
        with pytest.raises(ModelError, match=r"reference = 1\.5 m: expected at most 1 m"):
            slave.do_step(2 * H, H)
        assert everything(slave) == before
        assert len(slave.event_times) == n
    put(slave, reference=0.05)
    run(slave, 2, first=2)
    assert slave.memory[0] == 1.0
    reference = make("oscillator")
    run(reference, 2)
    put(reference, reference=0.05)
    run(reference, 2, first=2)
    assert slave.y.tolist() == reference.y.tolist()


def test_a_bug_in_an_event_is_told_with_its_traceback(make, put, capfd):
    slave = make("oscillator")
    slave.hosted = True  # as by pythonfmu's library, which logs the exception and gives an error
    slave.event = lambda t, h: 1 / 0
    put(slave, reference=0.5)
    before = everything(slave)
    with pytest.raises(FmuError) as error:
        slave.do_step(0.0, H)
    assert everything(slave) == before
    for text in (repr(error.value), capfd.readouterr().err):
        assert "ZeroDivisionError" in text
        assert "Traceback" in text
        assert "test_stepping.py" in text


def test_an_interrupt_is_passed_on_and_leaves_no_trace(make, put):
    slave = make("oscillator")
    run(slave, 2)

    def interrupted(t, h):
        slave.x[:] = 7.0
        raise KeyboardInterrupt

    slave.event = interrupted
    put(slave, reference=0.05)
    before = everything(slave)
    with pytest.raises(KeyboardInterrupt):
        slave.do_step(2 * H, H)
    assert everything(slave) == before
    del slave.event
    run(slave, 1, first=2)
    assert slave.memory[0] == 1.0


def test_an_event_may_be_requested_at_configuration(make):
    slave = make("oscillator", until="initialisation")
    slave.request_event()  # forgotten: configure() comes later
    configure = slave.configure
    slave.configure = lambda: (configure(), slave.request_event())
    slave.exit_initialization_mode()
    run(slave, 3)
    assert slave.event_times == [0.0]


def test_maps_of_another_shape_are_faults(make):
    slave = make("oscillator")
    slave.step_map = lambda h: np.zeros((2, 2))
    with pytest.raises(ValueError, match=r"step_map is of shape \(2, 2\); expected \(5, 6\)"):
        slave.do_step(0.0, H)


def test_maps_that_are_not_finite_are_refused(make):
    slave = make("oscillator")
    slave.step_map = lambda h: np.full((5, 6), np.nan)
    with pytest.raises(ModelError, match=r"Oscillator\.step_map contains numbers that are not finite"):
        slave.do_step(0.0, H)


def test_an_event_before_each_step_delays(make, put):
    slave = make("limiter")
    signal = [0.5, 2.0, -3.0, 0.1, 0.2]
    rows = []
    for i, value in enumerate(signal):
        put(slave, signal=value)
        assert slave.do_step(i * H, H)
        rows.append(slave.y.tolist())
    assert rows == [[0.5, 0.0], [1.0, 0.0], [-1.0, 0.5], [0.1, 1.0], [0.2, -1.0]]


def test_an_event_that_fails_after_it_has_written_leaves_no_trace(make, put):
    slave = make("limiter", limit=20.0)
    for value in (0.5, 0.6):
        put(slave, signal=value)
        assert slave.do_step(slave.time, H)
    put(slave, signal=13.0)
    before = everything(slave)
    for _ in range(2):
        with pytest.raises(ModelError):
            slave.do_step(2 * H, H)
        assert everything(slave)[0] == before[0]
    put(slave, signal=0.7)
    assert slave.do_step(2 * H, H)
    assert slave.y.tolist() == [0.7, 0.5]


def test_without_the_compiled_kernel_a_step_is_refused_with_the_command_that_makes_it(make, monkeypatch, tmp_path):
    slave = make("oscillator")
    before = everything(slave)
    monkeypatch.setattr(native, "FOLDER", tmp_path)
    monkeypatch.setattr(core, "find_library", lambda: native.load("numerics"))
    with pytest.raises(native.NotCompiledError, match=r"native\.json: No such file .* run 'make launcher'"):
        slave.do_step(0.0, H)
    assert everything(slave) == before
    monkeypatch.undo()
    assert slave.do_step(0.0, H)
