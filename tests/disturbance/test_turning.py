"""Wheels: speeds over time, multiples of an angle as products, the wrench that is made of their cosines and sines."""

import numpy as np
import pytest

from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.disturbance.spectrum import ramp
from ps_fmu.disturbance.turning import RPM, SpeedProfile, SpeedTable, plan_products
from ps_fmu.disturbance.wheels import FORCE, TORQUE, Harmonics, WheelSource, wheel_plane
from ps_fmu.mechanism.parameters import ParameterError, load
from ps_fmu.mechanism.quantities import replace_values

AXIS, POSITION = np.array([1.0, 2.0, -0.5]), np.array([0.3, -0.2, 0.1])
RUN_UP = SpeedProfile(-50.0, 600.0, 0.5, 3.0)  # rad/s, s: with the fade-in, all terms act


def turn(multiple: float, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The force of one harmonic of a wheel at 1 rad/s, over its size, and the cosine and sine that it has to be."""
    one, axis, steady = Harmonics(np.array([multiple]), np.ones(1)), np.array([0.0, 0.0, 1.0]), SpeedProfile(1, 1, 0, 0)
    wheel = WheelSource(steady, axis, np.zeros(3), (3,), rise_time=1e-9, force=one, torque=one)
    along, across = wheel_plane(axis)
    found = wheel(angle)[:, :3] @ np.stack([along, across], axis=1)
    phase = 2.0 * np.pi * np.random.Generator(np.random.Philox(np.random.SeedSequence((3,)))).random(2)[0]
    product = multiple * angle
    expected = np.stack([np.cos(product + phase), np.sin(product + phase)], axis=1)
    return found, expected


def test_all_around_the_circle_and_far_along() -> None:
    random = np.random.default_rng(1)
    for most, tolerance in ((10.0, 1e-13), (1e5, 1e-9)):  # the second: rounding of the product
        for multiple in random.uniform(0.1, 20.0, 7):
            found, expected = turn(float(multiple), random.uniform(0.1, most, 5000))
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)


def test_between_two_points_of_the_table() -> None:
    """Where the series are at their worst."""
    found, expected = turn(1.0, (np.arange(1024) + 0.5) * 2.0 * np.pi / 1024)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=6e-15)


@pytest.mark.parametrize("angle", [1e15, 1e17, 1e300])
def test_angles_without_a_fraction_stay_on_the_circle(angle: float) -> None:
    found, _ = turn(1.0, np.array([angle]))
    assert abs(np.hypot(*found[0]) - 1.0) < 1e-9


def test_a_wheel_is_the_second_derivative_of_its_harmonics() -> None:
    """Each harmonic by itself, from numpy's cosines and sines, with all terms of the run-up and of the fade-in."""
    wheel = WheelSource(RUN_UP, AXIS, POSITION, (7,), rise_time=1.0)
    phases = 2.0 * np.pi * np.random.Generator(np.random.Philox(np.random.SeedSequence((7,)))).random(24)
    time = np.linspace(0.0, 4.5, 3001)
    W, rate, rise = RUN_UP.speed(time), RUN_UP.acceleration(time), ramp(time, 1.0)
    force, torque = np.zeros((2, time.size, 3))
    one, other = wheel_plane(AXIS)
    for into, harmonics, first in ((force, FORCE, 0), (torque, TORQUE, 12)):
        for k, (order, size) in enumerate(zip(harmonics.orders, harmonics.coefficients, strict=True)):
            angle = order * RUN_UP.angle(time) + phases[first + k]
            along = np.outer(np.cos(angle), one) + np.outer(np.sin(angle), other)
            across = np.outer(-np.sin(angle), one) + np.outer(np.cos(angle), other)
            into += size * (rise.value * W**2)[:, None] * along
            into -= size / order * (rise.value * rate + 2.0 * rise.rate * W)[:, None] * across
            into -= size / order**2 * rise.curvature[:, None] * along
    torque += np.cross(POSITION, force)
    found = wheel(time)
    np.testing.assert_allclose(found[:, :3], force, rtol=0.0, atol=1e-12 * np.abs(force).max())
    np.testing.assert_allclose(found[:, 3:], torque, rtol=0.0, atol=1e-12 * np.abs(torque).max())


@pytest.mark.parametrize("size", [1, 7, 255, 256, 300, 1000])
def test_a_sample_does_not_depend_on_those_beside_it(size: int) -> None:
    wheel = WheelSource(RUN_UP, AXIS, POSITION, (7,), rise_time=1.0)
    time = np.arange(1, 2001) * 1e-3
    parts = [wheel(time[first : first + size]) for first in range(0, time.size, size)]
    np.testing.assert_array_equal(np.concatenate(parts), wheel(time))


WHEEL = tuple(np.unique(np.concatenate([FORCE.orders, TORQUE.orders])).tolist())


def make_all(plan, angle):
    """exp(i multiple angle) of all, as a plan says."""
    made = [np.exp(1j * multiple * angle) for multiple in plan.turned]
    for one, other, backwards in plan.products:
        made.append(made[one] * (made[other].conjugate() if backwards else made[other]))
    return made


@pytest.mark.parametrize(
    ("multiples", "turned"),
    [
        (WHEEL, 7),
        (tuple(float(k) for k in range(1, 30)), 1),
        ((0.1, 0.2, 0.3, 0.7), 2),  # as they are written: as doubles, 0.1 + 0.2 is more than 0.3
        ((1.0, 2.5, 7.1), 3),
        ((3.0,), 1),
        (tuple(np.sqrt(np.arange(2.0, 9.0)).tolist()), 7),
        (tuple(float(k) for k in range(1, 60)), 59),  # too many to look for products
        ((1e-5, 2e-5, 1e20), 2),
    ],
)
def test_all_multiples_from_few(multiples, turned):
    plan, angle = plan_products(multiples), 0.7
    made = make_all(plan, angle)
    assert len(plan.turned) == turned
    assert len(made) == len(plan.turned) + len(plan.products)
    for multiple in multiples:
        if multiple < 1e6:
            assert made[plan.place[multiple]] == pytest.approx(np.exp(1j * multiple * angle), abs=1e-14)


def test_products_come_after_what_they_are_made_of():
    plan = plan_products(WHEEL)
    for k, (one, other, _) in enumerate(plan.products, len(plan.turned)):
        assert one < k and other < k


STEP = 1e-4  # s
QUIET = replace_values(default_settings(load()), {"noise.enabled": False, "wheel_2.enabled": True})
NOTHING = Harmonics(np.array([1.0]), np.array([0.0]))


@pytest.fixture
def write(tmp_path):
    """Writes lines of time and speed into a file."""

    def write(*lines, header="time [s],speed [rpm]"):
        path = tmp_path / "speed.csv"
        path.write_text("\n".join([header, *lines, ""]))
        return str(path)

    return write


def test_two_rows_are_the_ramp():
    ramp = SpeedProfile(initial=100.0, final=-300.0, start=3.0, duration=5.0)
    table = SpeedTable(np.array([3.0, 8.0]), np.array([100.0, -300.0]))
    times = np.linspace(0.0, 10.0, 1001)
    for quantity in ("speed", "angle", "acceleration"):
        found, expected = (getattr(profile, quantity)(times) for profile in (table, ramp))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)
    assert table.highest == ramp.highest == 300.0


@pytest.mark.parametrize("start", [-2.0, 0.0, 1.5])
def test_the_angle_is_the_exact_integral_of_the_speed(start):
    random = np.random.default_rng(4)
    table = SpeedTable(start + np.cumsum(random.uniform(0.1, 1.0, 12)), random.uniform(-300.0, 300.0, 12))
    ends = np.concatenate([[0.0], table.times[table.times > 0.0], [9.0]])
    # The trapezoidal rule is exact over each linear piece.
    turns = 0.5 * (table.speed(ends[1:]) + table.speed(ends[:-1])) * np.diff(ends)
    np.testing.assert_allclose(table.angle(ends), np.concatenate([[0.0], np.cumsum(turns)]), rtol=1e-12, atol=1e-9)
    middle, h = 0.5 * (ends[1:] + ends[:-1]), 1e-5
    rate, curvature = ((f(middle + h) - f(middle - h)) / (2 * h) for f in (table.angle, table.speed))
    np.testing.assert_allclose(rate, table.speed(middle), atol=1e-5)
    np.testing.assert_allclose(curvature, table.acceleration(middle), atol=1e-5)


def test_zero_crossing_is_smooth_and_leaves_no_momentum():
    """Through zero and back: an unbalance on 1 kg stays on its circle."""
    corners = np.array([2.0, 4.0, 6.0]) + 0.5 * STEP  # where the acceleration jumps; the sums below take no part of it
    table = SpeedTable(corners, np.array([300.0, -100.0, 300.0]))
    harmonic = Harmonics(np.array([1.0]), np.array([1e-7]))
    wheel = WheelSource(table, np.array([0.0, 0.0, 1.0]), np.zeros(3), (5,), force=harmonic, torque=NOTHING)
    times = np.arange(80_001) * STEP
    force = wheel(times)[:, :2]
    still = np.argmin(np.abs(times - 3.5))
    np.testing.assert_allclose(np.linalg.norm(force[still]), 1e-7 * 200.0, rtol=1e-6)  # tangential: C W'
    assert np.abs(np.diff(force, axis=0)).max() < 2.0 * 1e-7 * 300.0**3 * STEP  # no jump in phase
    velocity = np.vstack([[0.0, 0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * STEP, axis=0)])
    assert np.abs(np.cumsum(velocity, axis=0) * STEP).max() <= 1.01e-7


def test_a_wheel_follows_its_file(write):
    path = write("0,0", "10,6000", "20,-3000")
    settings = replace_values(QUIET, {"wheel_2.speed_profile": path, "wheel_2.initial_speed": 5.0})
    wheel = settings.kinds["wheels"][1]
    np.testing.assert_allclose(wheel.profile.speed(np.array([5.0, 20.0, 99.0])), [3000 * RPM, -3000 * RPM, -3000 * RPM])
    ramp = {"wheel_2.initial_speed": 0.0, "wheel_2.final_speed": 6000 * RPM, "wheel_2.ramp_duration": 10.0}
    times = np.arange(1, 90_000, 13) * STEP
    np.testing.assert_allclose(
        Disturbance(settings)(times), Disturbance(replace_values(QUIET, ramp))(times), rtol=0.0, atol=1e-9
    )


def test_aliasing_is_judged_by_the_highest_speed_of_the_file(write):
    settings = replace_values(QUIET, {"wheel_2.speed_profile": write("0,0", "1,-6000", "2,0")})
    (text,) = Disturbance(settings).explain_aliasing(1e-3)
    assert text.startswith("wheel_2: harmonic 14.88 of 628.319 rad/s at 1488 Hz is above half the rate")


@pytest.mark.parametrize(
    ("lines", "header", "problem"),
    [
        (("0,0", "1,1"), "time [s],speed [rad/s]", r"line 1: column 'speed \[rad/s\]' must be 'speed \[rpm\]'"),
        (("0,0", "1,1"), "time,speed [rpm]", r"line 1: column 'time' must be 'time \[s\]'"),
        (("0,0", "1,fast"), "time [s],speed [rpm]", r"line 3: could not convert string 'fast' to float64 in column 2"),
        (("0,0", "0,1"), "time [s],speed [rpm]", "line 3: the time 0 s does not come after 0 s"),
        (("0,0",), "time [s],speed [rpm]", "has 1 lines of numbers"),
        (("0,0", "1,-2e6"), "time [s],speed [rpm]", r"speed\.csv: 2e\+06 rpm is beyond 1e\+06 rpm"),
    ],
)  # fmt: skip
def test_files_that_cannot_be_used(write, lines, header, problem):
    settings = replace_values(QUIET, {"wheel_2.speed_profile": write(*lines, header=header)})
    with pytest.raises(ParameterError, match=problem) as refusal:
        Disturbance(settings)
    assert str(refusal.value).startswith("wheel_2.speed_profile: ")


def test_a_wheel_that_is_off_reads_no_file():
    off = {"wheel_2.enabled": False, "wheel_2.speed_profile": "there-is-none.csv"}
    assert not Disturbance(replace_values(QUIET, off))(np.array([1.0])).any()
