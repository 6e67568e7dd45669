"""Speed of a wheel from a table: its integral, its ends, its files."""

import numpy as np
import pytest

from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.disturbance.kinds.wheels import Harmonics, WheelSource
from ps_fmu.disturbance.speed import RPM, SpeedProfile, SpeedTable
from ps_fmu.mechanism.parameters import ParameterError, load
from ps_fmu.mechanism.quantities import replace_values

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
        (("0,0", "1,fast"), "time [s],speed [rpm]", r"line 3: 'speed \[rpm\]': expected a number, got 'fast'"),
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
