"""LineOfSightSensor driven as a Python object: sample, latency, noise, lock, state."""

import numpy as np
import pytest
from support.models import Host

from ps_fmu.mechanism.rotations import from_rotation_vector, multiply
from ps_fmu.sensors.line_of_sight import DEFAULT_TRACKER, line_of_sight_error
from ps_fmu.slavekit.author.slave import Refused

H = 1e-3  # s
ERROR = tuple(f"line_of_sight_error.{axis}" for axis in "xyz")
QUIET = {f"noise_equivalent_angle__{axis}": 0.0 for axis in "xyz"}
PAYLOAD = from_rotation_vector(np.array([0.1, -0.2, 0.3]))


def attitude(name: str, q: np.ndarray) -> dict[str, float]:
    return {f"{name}__{k}": float(value) for k, value in zip("wxyz", q, strict=True)}


def turned(turn: list[float]) -> np.ndarray:
    """The payload's attitude, turned by a small rotation in its own axes."""
    return multiply(PAYLOAD, from_rotation_vector(np.array(turn)))


def make(**values: object) -> Host:
    start = {"acquisition_time": 0.0, "sample_time": 5 * H, "latency": 0.0, **attitude("payload_attitude", PAYLOAD)}
    return Host("line_of_sight_sensor", **{**start, **attitude("target_attitude", PAYLOAD), **values}).run_mode()


def run(host: Host, steps: int, turn=lambda k: [1e-5 * np.sin(0.03 * k), 2e-6 * k, -1e-6 * k]) -> np.ndarray:
    """Errors (steps, 3) measured while the target moves."""
    found = []
    for k in range(host.count, host.count + steps):
        host.set(**attitude("target_attitude", turned(turn(k))))
        host.step(H)
        found.append(host.get(*ERROR))
    return np.array(found)


def true_errors(steps: int, turn=lambda k: [1e-5 * np.sin(0.03 * k), 2e-6 * k, -1e-6 * k]) -> np.ndarray:
    return np.array([line_of_sight_error(PAYLOAD, turned(turn(k))) for k in range(steps)])


def test_samples_are_true_at_their_instant_and_stay() -> None:
    found, true = run(make(**QUIET), 100), true_errors(100)
    for k in range(5, 100):  # the lock takes two steps
        np.testing.assert_allclose(found[k], true[k // 5 * 5], atol=1e-15)


@pytest.mark.parametrize("steps", [1, 2, 7, 40])
def test_latency_is_a_shift(steps: int) -> None:
    at_once = run(make(), 120)
    later = run(make(latency=steps * H), 120)
    np.testing.assert_array_equal(later[steps - 1 :], at_once[: len(at_once) - steps + 1])
    assert not later[: steps - 1].any()


def test_noise_is_that_of_the_sample_whatever_the_step() -> None:
    noise = DEFAULT_TRACKER.noise(np.arange(40))
    found = run(make(), 200, lambda k: [0.0, 0.0, 0.0])
    np.testing.assert_allclose(found[5::5], noise[1:], atol=1e-15)
    coarse = make()
    for k in range(40):
        coarse.slave.do_step(k * 5 * H, 5 * H)
        if k > 1:
            np.testing.assert_allclose(coarse.get(*ERROR), noise[k], atol=1e-15)


def test_the_truss_turns_what_is_seen_and_the_platform_does_not() -> None:
    host = make(**QUIET, line_of_sight__x=3e-6, payload_rotation__x=1e-6, payload_rotation__y=-4e-6)
    host.step(H, 10)
    np.testing.assert_allclose(host.get(*ERROR), [-2e-6, -4e-6, 0.0], atol=1e-15)


def test_roll_on_request() -> None:
    host = make(roll_measured=False, **attitude("target_attitude", turned([0.0, 0.0, 1e-4])))
    host.step(H, 10)
    assert host.get(*ERROR)[2] == 0.0


def test_lock_takes_its_time_and_is_lost_at_the_edge() -> None:
    host = make(**QUIET, acquisition_time=20 * H, **attitude("target_attitude", turned([4e-4, 0.0, 0.0])))
    host.step(H, 20)
    assert not host.flag("locked")
    assert host.get(*ERROR) == [0.0, 0.0, 0.0]
    host.step(H, 5)
    assert host.flag("locked")
    host.set(**attitude("target_attitude", turned([0.9e-3, 0.0, 0.0])))  # beyond the acquisition field, in the other
    host.step(H, 5)
    assert host.flag("locked")
    assert host.get(*ERROR)[0] == pytest.approx(0.9e-3)
    host.set(**attitude("target_attitude", turned([1.1e-3, 0.0, 0.0])))
    host.step(H)
    assert not host.flag("locked")
    assert host.get(*ERROR) == [0.0, 0.0, 0.0]
    host.set(**attitude("target_attitude", turned([0.9e-3, 0.0, 0.0])))
    host.step(H, 60)
    assert not host.flag("locked")


def test_a_target_that_jumps_gives_no_sample_out_of_the_field() -> None:
    host = make(**QUIET)
    host.step(H, 11)
    host.set(**attitude("target_attitude", turned([0.1, 0.0, 0.0])))
    for _ in range(20):
        host.step(H)
        assert max(map(abs, host.get(*ERROR))) <= 1e-3


def test_hidden_targets_are_lost_and_won_again() -> None:
    host = make(acquisition_time=10 * H)
    host.step(H, 20)
    host.set(target_visible=False)
    host.step(H)
    assert not host.flag("locked")
    host.step(H, 30)
    host.set(target_visible=True)
    host.step(H, 10)
    assert not host.flag("locked")
    host.step(H, 5)
    assert host.flag("locked")


def test_a_target_behind_is_none() -> None:
    host = make(**attitude("target_attitude", turned([np.pi, 0.0, 0.0])))
    host.step(H, 20)
    assert not host.flag("locked")


def test_quaternions_of_another_size_are_warned_of(capsys) -> None:
    host = make(target_attitude__w=2.0)
    said: list[str] = []
    host.slave.warning = said.append
    host.step(H, 5)
    (text,) = said
    assert "expected unit quaternions" in text
    assert not host.flag("locked")


IN, NEAR, OUT = 0.3, 0.8, 1.2  # of half of the field; lock is acquired within 0.5
SEARCHING, ACQUIRING, LOCKED = 0.0, 1.0, 2.0


@pytest.mark.parametrize(
    ("lock", "place", "visible", "elapsed", "then"),
    [
        (SEARCHING, IN, True, 0.0, ACQUIRING),
        (SEARCHING, NEAR, True, 0.0, SEARCHING),
        (SEARCHING, IN, False, 0.0, SEARCHING),
        (ACQUIRING, IN, True, 0.4, ACQUIRING),
        (ACQUIRING, IN, True, 0.5, LOCKED),
        (ACQUIRING, NEAR, True, 0.5, SEARCHING),
        (LOCKED, NEAR, True, 0.0, LOCKED),
        (LOCKED, OUT, True, 0.0, SEARCHING),
        (LOCKED, -OUT, True, 0.0, SEARCHING),
        (LOCKED, IN, False, 0.0, SEARCHING),
    ],
)
def test_lock_from_each_state(lock: float, place: float, visible: bool, elapsed: float, then: float) -> None:
    host = make(acquisition_time=0.5)
    host.slave.lock[0], host.slave.x[0] = lock, elapsed
    turn = [0.5 * DEFAULT_TRACKER.field_of_view * place, 0.0, 0.0]
    host.set(target_visible=visible, **attitude("target_attitude", turned(turn)))
    host.step(H)
    assert host.slave.lock[0] == then
    assert host.flag("locked") == (then == LOCKED)
    going_on = lock == then == ACQUIRING
    assert host.slave.x[0] == (elapsed * going_on + H if then == ACQUIRING else 0.0)


@pytest.mark.parametrize("latency", [0.0, 0.4, 3.0, 7.3, 20.0])
def test_steps_of_any_size_are_those_of_a_fine_grid(latency: float) -> None:
    """Samples, their noise and their latency, at the steps' ends."""
    fine, coarse = (make(sample_time=2.3 * H, latency=latency * H) for _ in range(2))
    start = 0
    for k, n in enumerate([3, 17, 1, 20, 9, 23, 7, 20] * 20):  # steps of the fine grid
        turn = [1e-5 * np.sin(k), 2e-6 * k, 0.0] if k > 2 else [0.0, 0.0, 0.0]
        for host in (fine, coarse):
            host.set(**attitude("target_attitude", turned(turn)))
        fine.step(0.1 * H, n)
        assert coarse.slave.do_step(start * 0.1 * H, n * 0.1 * H)
        start += n
        if k < 3:  # the lock takes two steps
            continue
        assert (coarse.get(*ERROR), coarse.flag("locked")) == (fine.get(*ERROR), fine.flag("locked")), start
    assert coarse.flag("locked")


def test_a_latency_of_too_many_steps_is_refused() -> None:
    with pytest.raises(Refused, match="more than 1000 steps lie within a delay of 2 s"):
        make(latency=2.0).step(H, 1002)


def test_the_noise_is_displayed_in_a_unit_of_its_size():
    slave = Host("line_of_sight_sensor").slave
    ports = {port.name: port for port in slave.layout.ports}
    assert {ports[f"noise_equivalent_angle.{axis}"].display_unit for axis in "xyz"} == {"urad"}
    assert ports["field_of_view"].display_unit == "deg"
