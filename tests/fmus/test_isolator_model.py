"""FeedforwardIsolator driven as a Python object: gains, switching, delay, sampling, limit, state."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim
from support.mechanics import ORIENTATIONS_DEG, PAPER, pose_at
from support.models import Host

from ps_fmu.control.feedforward import Controller, gains, lowpass
from ps_fmu.slavekit.author.slave import ModelError, Refused

FORCES = ("fine_force_1", "fine_force_2", "fine_force_3")
H = 1e-3  # s


def acceleration(k: int) -> dict[str, float]:
    """Some motion of the base: deterministic, all axes."""
    names = [f"base_acceleration__{a}" for a in "xyz"] + [f"base_angular_acceleration__{a}" for a in "xyz"]
    return {name: 1e-3 * np.sin(0.02 * k * (i + 1) + i) for i, name in enumerate(names)}


def run(host: Host, steps: int, start: int = 0) -> np.ndarray:
    forces = []
    for k in range(start, start + steps):
        host.set(**acceleration(k))
        host.step(H)
        forces.append(host.get(*FORCES))
    return np.array(forces)


@pytest.mark.parametrize("rpy_deg", ORIENTATIONS_DEG)
def test_forces_are_those_of_the_controller(rpy_deg: tuple[float, float, float]) -> None:
    known = replace(PAPER.payload, com_P=PAPER.known_com_P)
    found = gains(PAPER.manipulator, known, pose_at(rpy_deg))
    c = Controller(found, lowpass(PAPER.filters), PAPER.filters)
    step, x, expected = c.step_map(H), np.zeros(c.n_states), []
    for k in range(50):
        result = step @ np.concatenate([x, list(acceleration(k).values())])
        expected.append(result[:3])
        x = result[3:]
    names = ("orientation__roll", "orientation__pitch", "orientation__yaw")
    host = Host("feedforward_isolator", **dict(zip(names, np.radians(rpy_deg).tolist(), strict=True))).run_mode()
    np.testing.assert_allclose(run(host, 50), expected, rtol=1e-10, atol=1e-14)


def test_payload_as_known_has_no_truss_that_its_mass_would_have_to_carry() -> None:
    light = Host("feedforward_isolator", payload__mass=0.3, payload__com__z=-1.0).run_mode()
    assert run(light, 3).any()


def test_no_force_in_initialisation_mode_whatever_the_inputs() -> None:
    """Strictly proper: no algebraic loop with the plant at the start."""
    host = Host("feedforward_isolator", **acceleration(5))
    assert host.get(*FORCES) == [0.0, 0.0, 0.0]


def test_disabled_gives_no_force_but_goes_on_measuring() -> None:
    always = Host("feedforward_isolator").run_mode()
    switched = Host("feedforward_isolator", enabled=False).run_mode()
    expected = run(always, 40)
    assert not run(switched, 20).any()
    switched.set(enabled=True)
    np.testing.assert_allclose(run(switched, 20, 20), expected[20:], rtol=1e-12)
    switched.set(enabled=False)
    assert not run(switched, 3, 40).any()


@pytest.mark.parametrize("start", [{}, {"delay": 0.02}, {"sample_time": 10 * H}], ids=str)
def test_switching_off_takes_the_force_away_at_once(start: dict) -> None:
    host = Host("feedforward_isolator", **start).run_mode()
    assert run(host, 45)[-1].any()
    host.set(enabled=False)
    assert not run(host, 40, 45).any()


def test_gains_follow_the_orientation() -> None:
    there = Host("feedforward_isolator", orientation__roll=0.1).run_mode()
    turned = Host("feedforward_isolator").run_mode()
    other = run(Host("feedforward_isolator").run_mode(), 3)
    turned.set(orientation__roll=0.1)
    first = run(turned, 3)
    np.testing.assert_allclose(first, run(there, 3), rtol=1e-12)
    assert np.abs(first - other).max() > 1e-3 * np.abs(other).max()


@pytest.mark.parametrize("steps", [1, 7, 200])
def test_delay_is_a_shift(steps: int) -> None:
    plain = run(Host("feedforward_isolator").run_mode(), 250)
    delayed = run(Host("feedforward_isolator", delay=steps * H).run_mode(), 250)
    assert not delayed[:steps].any()
    np.testing.assert_array_equal(delayed[steps:], plain[:-steps])


def test_delay_in_steps_of_any_size_is_a_shift() -> None:
    """The forces that were there at least the delay ago, whatever the steps between."""
    plain, delayed = (Host("feedforward_isolator", delay=delay).run_mode() for delay in (0.0, 0.0123))
    times, forces = [-1.0], [[0.0, 0.0, 0.0]]
    time = 0.0
    for k, h in enumerate([H, 0.3 * H, 2.7 * H, 1e-8, 11.0 * H] * 20):
        for host in (plain, delayed):
            host.set(**acceleration(k))
            assert host.slave.do_step(time, h)
        time += h
        times.append(time)
        forces.append(plain.get(*FORCES))
        assert delayed.get(*FORCES) == forces[int(np.searchsorted(times, time - 0.0123 + 1e-9)) - 1]


def test_a_delay_of_too_many_steps_is_refused() -> None:
    host = Host("feedforward_isolator", delay=1.0).run_mode()
    run(host, 1001)
    host = Host("feedforward_isolator", delay=5.0).run_mode()
    with pytest.raises(Refused, match="more than 1000 steps lie within a delay of 5 s"):
        run(host, 1002)


def test_force_limit_clips_and_says_so() -> None:
    host = Host("feedforward_isolator", force_limit=1e-3, base_acceleration__x=1.0).run_mode()
    host.step(H, 5)
    assert host.flag("saturated")
    assert np.abs(host.get(*FORCES)).max() <= 1e-3
    free = Host("feedforward_isolator", base_acceleration__x=1.0).run_mode()
    free.step(H, 5)
    assert not free.flag("saturated")
    assert np.abs(free.get(*FORCES)).max() > 1e-3


def test_limit_does_not_wind_up_the_filters() -> None:
    limited = Host("feedforward_isolator", force_limit=1e-6).run_mode()
    free = Host("feedforward_isolator").run_mode()
    run(limited, 20)
    run(free, 20)
    np.testing.assert_allclose(limited.slave.x, free.slave.x)


def test_sampled_controller_is_the_controller_at_its_own_period() -> None:
    """Period of four steps: inputs sampled and outputs changed only there, like a slave stepped four times as long."""
    sampled = Host("feedforward_isolator", sample_time=4 * H).run_mode()
    own = Host("feedforward_isolator").run_mode()
    forces = run(sampled, 40)
    expected = []
    for k in range(10):
        own.set(**acceleration(4 * k))
        assert own.slave.do_step(4 * k * H, 4 * H)
        expected.append(own.get(*FORCES))
    np.testing.assert_allclose(forces[3::4], expected, rtol=1e-8, atol=1e-12)
    np.testing.assert_array_equal(forces[4:7], np.repeat(forces[3:4], 3, axis=0))


def test_a_period_below_the_step_is_that_of_the_step() -> None:
    short, none = (Host("feedforward_isolator", sample_time=period).run_mode() for period in (4e-10, 0.0))
    np.testing.assert_allclose(run(short, 40), run(none, 40), rtol=1e-12)


def test_the_controller_samples_at_its_own_times() -> None:
    """Forces change at the end of the step into which a multiple of the period falls."""
    host = Host("feedforward_isolator", sample_time=10 * H).run_mode()
    time, changed, before = 0.0, [], [0.0, 0.0, 0.0]
    for k, h in enumerate([H] * 3 + [0.7 * H] * 10 + [2.35 * H] * 14):
        host.set(**acceleration(k))
        assert host.slave.do_step(time, h)
        time += h
        if host.get(*FORCES) != before:
            changed.append(round(time / H, 3))
        before = host.get(*FORCES)
    assert changed == [10.0, 21.75, 31.15, 40.55]


def test_rounding_of_the_orientation_is_no_turn() -> None:
    host = Host("feedforward_isolator", orientation__roll=0.1).run_mode()
    for k in range(20):
        host.set(orientation__roll=0.1 + 1e-16 * (k // 3))
        host.step(H)
    assert host.slave.kept[0] == 0.1
    host.set(orientation__roll=0.1 + 1e-9)
    host.step(H)
    assert host.slave.kept[0] == 0.1 + 1e-9


NAMES = ("orientation__roll", "orientation__pitch", "orientation__yaw")


@pytest.mark.parametrize("start", [{}, {"sample_time": 2 * H}], ids=str)
def test_gains_in_a_slew_are_those_of_each_orientation(start: dict) -> None:
    """Against formulas (52) to (54) in each step, with the masses of the derived mechanism."""
    host = Host("feedforward_isolator", **start).run_mode()
    c, worst, largest = host.slave.isolator, 0.0, 0.0
    x = np.zeros(c.controller(np.zeros(3)).n_states)
    every = 2 if start else 1
    for k in range(200):
        angle = 0.1 * np.sin(0.02 * k)
        orientation = np.array([angle, angle**2, -0.5 * angle])
        host.set(**dict(zip(NAMES, orientation.tolist(), strict=True)), **acceleration(k // every * every))
        host.step(H)
        result = c.controller(orientation).step_map(H) @ np.concatenate([x, host.slave.u[:6]])
        x = result[3:]
        if k % every == every - 1:
            worst = max(worst, np.abs(result[:3] - host.get(*FORCES)).max())
        largest = max(largest, np.abs(result[:3]).max())
    verify_claim(
        "model.isolator_in_slews",
        claim="Forces of the isolator in a slew",
        where="FMU `FeedforwardIsolator`, `ps-fmu run slew`: `fine_force`",
        reference="gains (52) to (54) by the masses of the derived mechanism, at the orientation of each step",
        error=worst / largest,
        bound=1e-11,
    )


def test_unreachable_orientation_is_said_and_can_be_put_right() -> None:
    host = Host("feedforward_isolator", nominal_translation__z=0.15).run_mode()  # a low platform meets its limit
    host.set(orientation__roll=1.5)
    with pytest.raises(Refused, match=r"orientation \(85.94, 0, 0\) deg: no pose with the fine legs at rest"):
        host.step(H)
    host.set(orientation__roll=0.0)
    host.step(H)


@pytest.mark.parametrize(
    ("name", "value"),
    [("payload__mass", 0.0), ("fine_leg_2__stiffness", 0.0), ("filters__lowpass_stop_frequency", 0.0)],
)
def test_impossible_parameter_is_named(name: str, value: float) -> None:
    host = Host("feedforward_isolator", **{name: value})
    with pytest.raises(ModelError, match=name.replace("__", r"\.")):
        host.run_mode()
