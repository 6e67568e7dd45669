"""PointingController driven as a Python object: the law, gains, lock, limit, sampling, delay, state."""

import numpy as np
import pytest
from support.mechanics import PAPER
from support.models import Host

from ps_fmu.control.pointing import PointingLaw
from ps_fmu.slavekit.author.slave import Refused

H = 1e-3  # s
FORCES = ("fine_force_1", "fine_force_2", "fine_force_3")
LAW = PointingLaw.from_parameters(PAPER)


def error(k: int) -> np.ndarray:
    return 1e-6 * np.sin(0.05 * k * np.array([1.0, 2.0, 3.0]) + np.arange(3))


def run(host: Host, steps: int, of=error) -> np.ndarray:
    found = []
    for k in range(host.count, host.count + steps):
        host.set(**{f"line_of_sight_error__{axis}": float(e) for axis, e in zip("xyz", of(k), strict=True)})
        host.step(H)
        found.append(host.get(*FORCES))
    return np.array(found)


def by_law(steps: int, orientation=(0.0, 0.0, 0.0), limit: float = np.inf, of=error) -> np.ndarray:
    """The forces of the law, with what the limit cut off in the step before."""
    controller = LAW.controller(np.array(orientation))
    Ad, Bd = controller.hold(H)
    x, excess, found = np.zeros(12), np.zeros(3), []
    for k in range(steps):
        x = Ad @ x + Bd @ np.concatenate([of(k), excess])
        force = controller.output_map() @ x
        excess = force - np.clip(force, -limit, limit)
        found.append(np.clip(force, -limit, limit))
    return np.array(found)


@pytest.mark.parametrize("orientation", [(0.0, 0.0, 0.0), (0.08, -0.05, 0.1)])
def test_forces_are_those_of_the_law(orientation) -> None:
    start = dict(zip(("orientation__roll", "orientation__pitch", "orientation__yaw"), orientation, strict=True))
    found = run(Host("pointing_controller", **start).run_mode(), 60)
    np.testing.assert_allclose(found, by_law(60, orientation), rtol=1e-9, atol=1e-15)


def test_a_force_at_its_limit_goes_back_to_the_integrals() -> None:
    def large(k: int) -> np.ndarray:
        return np.array([2e-4 if k < 300 else -1e-4, 0.0, 0.0])

    host = Host("pointing_controller", force_limit=0.5).run_mode()
    found = run(host, 300, large)
    assert host.flag("saturated")
    np.testing.assert_allclose(found, by_law(300, limit=0.5, of=large), rtol=1e-9, atol=1e-15)
    # Without the return of what was cut off it would take twice as long as it took to get there: 0.6 s.
    run(host, 230, large)
    assert not host.flag("saturated")


def test_without_lock_the_last_force_stays() -> None:
    host = Host("pointing_controller").run_mode()
    run(host, 300)
    host.set(locked=False)
    run(host, 1500)
    held = run(host, 200)
    assert np.abs(held).min(axis=0).max() > 0.0
    np.testing.assert_allclose(held, np.broadcast_to(held[0], held.shape), rtol=1e-9)
    host.set(locked=True)
    assert np.ptp(run(host, 200), axis=0).max() > 1e-3 * np.abs(held).max()


def test_disabled_gives_no_force_at_once_and_begins_anew() -> None:
    host = Host("pointing_controller", delay=20 * H).run_mode()
    run(host, 100)
    host.set(enabled=False)
    assert not run(host, 30).any()
    host.set(enabled=True)
    found = run(host, 60, lambda k: error(k - 130))
    np.testing.assert_allclose(found[20:], by_law(40), rtol=1e-9, atol=1e-15)


def test_gains_follow_the_orientation() -> None:
    """Against the law in each step; its filter is one for all orientations."""
    host = Host("pointing_controller").run_mode()
    x, worst, largest = np.zeros(12), 0.0, 0.0
    for k in range(200):
        roll = 0.1 * np.sin(0.02 * k)
        host.set(orientation__roll=roll, orientation__yaw=-0.5 * roll)
        found = run(host, 1)[0]
        controller = LAW.controller(np.array([roll, 0.0, -0.5 * roll]))
        Ad, Bd = controller.hold(H)
        x = Ad @ x + Bd[:, :3] @ error(k)
        force = controller.output_map() @ x
        worst, largest = max(worst, np.abs(found - force).max()), max(largest, np.abs(force).max())
    assert worst < 1e-11 * largest


@pytest.mark.parametrize("steps", [1, 9])
def test_delay_is_a_shift(steps: int) -> None:
    plain, late = (run(Host("pointing_controller", delay=delay).run_mode(), 60) for delay in (0.0, steps * H))
    np.testing.assert_array_equal(late[steps:], plain[:-steps])


def test_sampling_and_delay_in_steps_of_any_size() -> None:
    """Forces leave at the first end of a step that is the delay after the multiple of the period they are made at."""
    host = Host("pointing_controller", sample_time=3 * H, delay=5 * H).run_mode()
    start, made, late, before = 0.0, [], [], [0.0, 0.0, 0.0]
    for k, h in enumerate([2.0, 1.3, 0.4, 2.8, 3.0, 0.7, 0.3, 0.1] * 12):
        host.set(**{f"line_of_sight_error__{axis}": float(e) for axis, e in zip("xyz", error(k), strict=True)})
        assert host.slave.do_step(start * H, h * H)
        made += [m for m in range(3, 400, 3) if start + 1e-9 < m <= start + h + 1e-9]
        start += h
        if host.get(*FORCES) != before:
            late.append(start)
        before = host.get(*FORCES)
        due = [m for m in made if m + 5 <= start + 1e-9]
        assert len(late) == len(due)
        assert not late or late[-1] < due[-1] + 5 + 3.0


def test_a_digital_controller_is_the_law_at_its_period() -> None:
    """Ten steps of a sampled controller are one of the law with that step."""
    found = run(Host("pointing_controller", sample_time=10 * H).run_mode(), 200)
    controller = LAW.controller(np.zeros(3))
    Ad, Bd = controller.hold(10 * H)
    x = np.zeros(12)
    for k in range(20):
        x = Ad @ x + Bd @ np.concatenate([error(10 * k), np.zeros(3)])
        np.testing.assert_allclose(found[10 * k + 9], controller.output_map() @ x, rtol=1e-8, atol=1e-15)
        held = found[10 * k + 9 : 10 * k + 19]
        np.testing.assert_array_equal(held, np.broadcast_to(held[0], held.shape))


def test_an_unreachable_orientation_is_refused_and_can_be_put_right() -> None:
    host = Host("pointing_controller", nominal_translation__z=0.15).run_mode()
    host.set(orientation__roll=1.5)
    with pytest.raises(Refused, match=r"orientation \(85.94, 0, 0\) deg: no pose"):
        host.step(H)
    host.set(orientation__roll=0.0)
    host.step(H)
