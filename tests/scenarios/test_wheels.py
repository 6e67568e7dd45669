"""The scenario wheels: amplitudes of lines, crossings of modes, and the scenario through the real FMUs."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter
from support.claims import verify_claim

from ps_fmu.disturbance.turning import RPM, SpeedProfile, SpeedTable
from ps_fmu.disturbance.wheels import Harmonics, WheelSource
from ps_fmu.product.files import find_product
from ps_fmu.runs.options import OptionError
from ps_fmu.runs.run import execute
from ps_fmu.scenarios.wheel_lines import (
    Spectrogram,
    Wheel,
    find_crossings,
    make_spectrogram,
    measure_crossings,
    measure_ellipse,
    track_line,
)
from ps_fmu.scenarios.wheels import CaseLines, describe_speed, describe_worst, list_worst, make_waterfall
from ps_fmu.theory.natural_modes import NaturalMode

STEP, DURATION = 1e-3, 60.0  # s
TIME = np.arange(round(DURATION / STEP) + 1) * STEP
MODES = [NaturalMode("mast mode 1", 30.0, 0.01), NaturalMode("mast mode 2", 90.0, 0.01)]
AXIS = np.array([0.0, 0.0, 1.0])


def make_wheel(profile, orders=(1.0, 2.0), name="wheel_1"):
    force = Harmonics(np.array(orders), np.full(len(orders), 1e-7))
    nothing = Harmonics(np.array(orders[:1]), np.zeros(1))
    return Wheel(name, profile, WheelSource(profile, AXIS, np.zeros(3), (1,), force=force, torque=nothing))


RUN_UP = make_wheel(SpeedProfile(0.0, 6000.0 * RPM, 0.0, DURATION))


def flat(frequency):
    """A payload that turns by 1 rad per newton about x and y, whatever the frequency is."""
    return np.tile(np.eye(3, 6, dtype=complex), (len(frequency), 1, 1))


# --- Amplitudes -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("amplitude", "largest"),
    [([3.0, 0.0, 0.0], 3.0), ([1.0, 1j, 0.0], 1.0), ([1.0, 1.0, 1.0], 3.0**0.5), ([2.0, 1j, 0.0], 2.0)],
)
def test_the_amplitude_of_a_vector_is_its_largest_magnitude(amplitude, largest):
    a = np.array(amplitude)
    phases = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 1000))
    assert np.linalg.norm((phases[:, None] * a).real, axis=1).max() == pytest.approx(largest, rel=1e-4)
    assert measure_ellipse(a) == pytest.approx(largest, rel=1e-12)


def test_a_steady_line_in_the_spectrogram():
    bin_hz = 1.0 / (512 * STEP)
    line = 3e-6 * np.cos(2.0 * np.pi * 40 * bin_hz * TIME)
    found = make_spectrogram(np.array([line, 0.0 * line, 0.0 * line]), STEP, 200.0)
    assert len(found.time) > 390 and found.frequency[-1] <= 200.0
    assert found.frequency[1] == pytest.approx(bin_hz)
    assert 0.0 < found.time[0] < 0.5 and DURATION - 0.5 < found.time[-1] < DURATION
    np.testing.assert_allclose(found.amplitude[:, 40], 3e-6, rtol=1e-3)
    assert found.amplitude[:, 60:].max() < 1e-3 * 3e-6  # 40 Hz away


def test_a_short_run_has_shorter_windows():
    found = make_spectrogram(np.ones((3, 20)), STEP, 500.0)
    assert found.amplitude.shape == (len(found.time), len(found.frequency))
    with pytest.raises(ValueError, match="expected 16 rows at least, got 15"):
        make_spectrogram(np.ones((3, 15)), STEP, 500.0)


def test_a_line_is_tracked_through_others_while_the_speed_changes():
    """Amplitudes at 20 s: 2e-6 of order 2, beside 1e-5 of order 1, an offset and a drift."""
    angle = RUN_UP.profile.angle(TIME)
    signals = np.zeros((3, len(TIME)))
    signals[0] = 1e-7 * TIME * np.cos(2.0 * angle + 0.3) + 1e-5 * np.sin(angle)
    signals[1] = 1e-4 + 1e-7 * TIME
    found = track_line(signals, STEP, 2.0 * angle, 20.0, 66.7)
    assert found == pytest.approx(2e-6, rel=0.03)  # it grows by 2 % within a window, and is looked at until 0.4 s later


# --- Crossings --------------------------------------------------------------------------


def test_crossings_of_a_run_up():
    found = find_crossings([RUN_UP], MODES, DURATION, flat)
    places = {(each.order, each.mode.frequency): each for each in found}
    assert places.keys() == {(1.0, 30.0), (2.0, 30.0), (1.0, 90.0), (2.0, 90.0)}
    for (order, frequency), each in places.items():
        assert each.speed == pytest.approx(2.0 * np.pi * frequency / order)
        assert each.time == pytest.approx(DURATION * frequency / order / 100.0, abs=1e-6)
        assert each.steady == pytest.approx(1e-7 * each.speed**2)
    assert [each.steady for each in found] == sorted((each.steady for each in found), reverse=True)


def test_a_zero_crossing_meets_a_mode_four_times_and_a_constant_speed_never():
    table = SpeedTable(np.array([0.0, 30.0, 60.0]), np.array([3000.0, -3000.0, 3000.0]) * RPM)
    found = find_crossings([make_wheel(table, (1.0,))], MODES[:1], DURATION, flat)
    assert sorted(each.time for each in found) == pytest.approx([6.0, 24.0, 36.0, 54.0], abs=1e-6)
    assert [np.sign(each.speed) for each in sorted(found, key=lambda each: each.time)] == [1.0, -1.0, -1.0, 1.0]
    on_the_mode = SpeedProfile(2.0 * np.pi * 30.0, 2.0 * np.pi * 30.0, 0.0, 0.0)
    assert find_crossings([make_wheel(on_the_mode)], MODES, DURATION, flat) == []


def test_the_worst_crossing_of_a_run_is_where_the_payload_moves_most():
    """A signal with a swelling of 5e-6 rad of order 1 at 30 Hz, and 1e-6 rad of order 2 throughout."""
    angle = RUN_UP.profile.angle(TIME)
    swelling = 5e-6 * np.exp(-(((TIME - 18.0) / 3.0) ** 2))
    signals = np.vstack([swelling * np.cos(angle) + 1e-6 * np.cos(2.0 * angle + 1.0), np.zeros((2, len(TIME)))])
    measured = measure_crossings(find_crossings([RUN_UP], MODES, DURATION, flat), [RUN_UP], signals, STEP, flat)
    worst = measured[0]
    assert (worst.order, worst.mode.name) == (1.0, "mast mode 1")
    assert worst.amplitude == pytest.approx(5e-6, rel=0.02)
    assert [each.amplitude for each in measured if each.order == 2.0] == pytest.approx([1e-6] * 2, rel=0.02)
    text = describe_worst("passive", CaseLines(None, measured, 6e-6, 18.2), [RUN_UP])
    assert text == (
        "Worst crossing, passive: wheel_1, harmonic 1 at 1800 rpm crosses mast mode 1 (30 Hz). Amplitude of this "
        "harmonic in the payload's rotation: 5 \N{MICRO SIGN}rad in the run, 3.55 mrad at constant speed. Largest "
        "rotation of the run, all together: 6 \N{MICRO SIGN}rad at 18.2 s (wheel_1 at 1820 rpm)."
    )
    assert worst.entry["speed_rpm"] == pytest.approx(1800.0) and worst.entry["mode"] == "mast mode 1"


def test_what_a_run_cannot_tell_apart_is_one_crossing():
    """Orders 1 and 1.02 differ by 0.6 Hz at 30 Hz; the one that is stronger at constant speed stands for both."""
    force = Harmonics(np.array([1.0, 1.02]), np.array([1e-7, 3e-7]))
    nothing = Harmonics(np.array([1.0]), np.zeros(1))
    source = WheelSource(RUN_UP.profile, AXIS, np.zeros(3), (1,), force=force, torque=nothing)
    wheel = Wheel("wheel_1", RUN_UP.profile, source)
    found = find_crossings([wheel], MODES[:1], DURATION, flat)
    assert len(found) == 2
    (kept,) = measure_crossings(found, [wheel], np.ones((3, len(TIME))), STEP, flat)
    assert kept.order == 1.02


def test_crossings_too_fast_to_be_seen_are_left_out():
    """At 0.2 Hz three periods last 15 s, in which the wheel speeds up from 0 to 1500 rpm."""
    slow = [NaturalMode("bus mode 1", 0.2, 0.005)]
    found = find_crossings([RUN_UP], slow, DURATION, flat)
    assert len(found) == 2 and measure_crossings(found, [RUN_UP], np.ones((3, len(TIME))), STEP, flat) == []
    assert describe_worst("active", CaseLines(None, [], 1e-9, 30.0), [RUN_UP]) == (
        "Worst crossing, active: none; no harmonic that makes most at its speed crosses a mode slowly enough to be "
        "seen. Largest rotation of the run, all together: 1 nrad at 30 s (wheel_1 at 3000 rpm)."
    )


# --- A payload on a spring, without FMUs ------------------------------------------------

PEAK, DAMPING = 90.0, 0.01  # Hz
ORDERS, COEFFICIENTS = (1.0, 6.78, 8.73), (1e-9, 1e-7, 6e-8)
SPRING = cont2discrete(
    ([PEAK * 2.0 * np.pi], [1.0, 4.0 * np.pi * DAMPING * PEAK, (2.0 * np.pi * PEAK) ** 2]), STEP, "zoh"
)[:2]


def answer(frequency):
    """The payload turns about x and y as a spring with its peak at 90 Hz, whatever the mode is called."""
    z = np.exp(2j * np.pi * np.asarray(frequency) * STEP)
    return (np.polyval(SPRING[0][0], z) / np.polyval(SPRING[1], z))[:, None, None] * np.eye(3, 6)


def simulate(*wheels):
    wrench = sum(wheel.source(TIME) for wheel in wheels)
    return lfilter(SPRING[0][0], SPRING[1], wrench[:, :3], axis=0).T


def spin(first, last, name="wheel_1", coefficients=COEFFICIENTS):
    profile = SpeedProfile(first * RPM, last * RPM, 0.0, DURATION if first != last else 0.0)
    force, nothing = Harmonics(np.array(ORDERS), np.array(coefficients)), Harmonics(np.array(ORDERS[:1]), np.zeros(1))
    return Wheel(name, profile, WheelSource(profile, AXIS, np.zeros(3), (1,), force=force, torque=nothing))


def measure(*wheels):
    modes = [NaturalMode("mast mode 1", 88.0, DAMPING)]
    return measure_crossings(find_crossings(wheels, modes, DURATION, answer), wheels, simulate(*wheels), STEP, answer)


def largest_steady(order):
    """By brute force over the frequency, rad."""
    frequency = np.linspace(80.0, 100.0, 20_001)
    sizes = dict(zip(ORDERS, COEFFICIENTS, strict=True))[order] * (2.0 * np.pi * frequency / order) ** 2
    turned = sizes * np.abs(answer(frequency)[:, 0, 0])
    return frequency[turned.argmax()], turned.max()


@pytest.mark.parametrize(("order", "first", "last"), [(6.78, 740.0, 850.0), (8.73, 580.0, 660.0)])
def test_a_slow_run_up_reaches_the_peak_at_constant_speed(order, first, last):
    """At the peak of the answer, not at the frequency of the mode that it is named by."""
    crossing = next(each for each in measure(spin(first, last)) if each.order == order)
    frequency, steady = largest_steady(order)
    assert crossing.amplitude == pytest.approx(steady, rel=0.02)
    assert crossing.mode.frequency == 88.0
    speed = 2.0 * np.pi * frequency / order
    verify_claim(
        "wheel.worst_speed",
        claim="Worst constant speed of a wheel near a mode, and the amplitude there",
        where="`ps-fmu run wheels`: table of crossings, report, worst_crossing of summary.json",
        reference="largest of 20,001 speeds, one after the other, of a spring whose peak is not at the mode",
        error=np.abs([crossing.speed / speed - 1.0, crossing.steady / steady - 1.0]),
        bound=1e-3,
    )


def test_a_fast_run_up_stays_below_the_peak_at_constant_speed():
    (worst, second) = measure(spin(500.0, 3000.0))
    assert (worst.order, second.order) == (6.78, 8.73)
    assert 0.3 < worst.amplitude / worst.steady < 0.9


@pytest.mark.parametrize("ends", [(740.0, 850.0), (500.0, 3000.0)])
def test_wheels_at_constant_speed_beside_change_nothing(ends):
    """Two with larger lines at 90.3 and 91.1 Hz: the harmonic is what it is alone."""
    wheel = spin(*ends)
    others = [spin(speed, speed, f"wheel_{k}", (0.0, 2e-7, 3e-7)) for k, speed in ((2, 799.0), (3, 626.0))]
    alone, beside = measure(wheel), measure(wheel, *others)
    assert [each.order for each in beside] == [each.order for each in alone]
    assert [each.steady for each in beside] == [each.steady for each in alone]
    spoilt = np.abs(simulate(wheel, *others)).max() / np.abs(simulate(wheel)).max()
    assert spoilt > 1.5  # the largest rotation is another: it is that of all together
    verify_claim(
        "wheel.crossing_beside_others",
        claim="Amplitude of the one harmonic at a crossing, beside wheels at constant speed",
        where="`ps-fmu run wheels`: peak amplitude in table, report and summary.json",
        reference="run-ups of the wheel alone, slow and fast, on a spring without FMUs",
        error=[abs(other.amplitude / one.amplitude - 1.0) for one, other in zip(alone, beside, strict=True)],
        bound=0.03,
    )


def test_a_harmonic_that_another_of_its_wheel_hides_is_no_crossing():
    """At 90 Hz of order 6.78 order 1 makes ten times as much, off resonance."""
    wheel = spin(740.0, 850.0, coefficients=(1e-5, 1e-9, 0.0))
    assert len(find_crossings([wheel], [NaturalMode("mast mode 1", 88.0, DAMPING)], DURATION, answer)) == 1
    assert measure(wheel) == []


def test_a_harmonic_beside_one_of_another_run_up_has_no_amplitude():
    one, other = spin(740.0, 850.0), spin(738.0, 851.0, "wheel_2")
    measured = measure(one, other)
    assert len(measured) == 1  # that a run cannot tell them apart makes them one
    assert np.isnan(measured[0].amplitude) and measured[0].entry["peak_amplitude_rad"] is None
    text = describe_worst("active", CaseLines(None, measured, 1e-3, 30.0), [one, other])
    assert "not to be told from lines of other wheels in the run, " in text and "wheel_2 at 794 rpm" in text


# --- Waterfall --------------------------------------------------------------------------


def make_case(profile):
    time = np.linspace(0.5, DURATION - 0.5, 101)
    rows = np.abs(profile.speed(time)) / RPM
    amplitude = np.tile(rows[:, None], (1, 3))  # each row says its own speed
    crossings = find_crossings([make_wheel(profile)], MODES, DURATION, flat)
    return CaseLines(Spectrogram(time, np.array([0.0, 50.0, 100.0]), amplitude), crossings, 1e-6, 1.0)


@pytest.mark.parametrize("ends", [(0.0, 6000.0), (6000.0, 600.0)])
def test_a_waterfall_over_speed(ends):
    profile = SpeedProfile(ends[0] * RPM, ends[1] * RPM, 0.0, DURATION)
    shown = make_waterfall({"passive": make_case(profile)}, [make_wheel(profile)], MODES, "title")
    assert (shown.label, shown.ordinate_unit) == ("speed of wheel_1", "rpm")
    assert (np.diff(shown.ordinate) > 0.0).all()
    step = 2.0 * abs(ends[1] - ends[0]) / 100.0
    np.testing.assert_allclose(shown.panels[0].amplitude[:, 0], shown.ordinate, atol=step)
    np.testing.assert_allclose(shown.lines[1].frequency, 2.0 * shown.ordinate / 60.0, rtol=1e-9)
    mark = shown.panels[0].mark
    assert mark.frequency == 90.0 and mark.ordinate == pytest.approx(5400.0, rel=1e-6)


def test_a_waterfall_over_time_where_a_speed_comes_twice():
    profile = SpeedTable(np.array([0.0, 30.0, 60.0]), np.array([3000.0, 0.0, 3000.0]) * RPM)
    constant = make_wheel(SpeedProfile(100.0, 100.0, 0.0, 0.0), name="wheel_4")
    shown = make_waterfall({"active": make_case(profile)}, [constant, make_wheel(profile)], MODES, "title")
    assert (shown.label, shown.ordinate_unit) == ("time", "s")
    np.testing.assert_array_equal(shown.ordinate, make_case(profile).spectrogram.time)
    assert np.ptp(shown.lines[0].frequency) == 0.0 and np.ptp(shown.lines[-1].frequency) > 40.0


@pytest.mark.parametrize(
    ("profile", "text"),
    [
        (SpeedProfile(100.0 * RPM, 100.0 * RPM, 0.0, 0.0), "wheel_1 at 100 rpm"),
        (SpeedProfile(-50.0 * RPM, 3000.0 * RPM, 1.0, 5.0), "wheel_1 from -50 to 3000 rpm"),
        (
            SpeedTable(np.array([0.0, 10.0, 60.0]), np.array([0.0, -40.0, 70.0]) * RPM),
            "wheel_1 between -40 and 70 rpm",
        ),
    ],
)
def test_speeds_in_words(profile, text):
    assert describe_speed(make_wheel(profile), DURATION) == text


def test_nothing_is_crossed():
    assert list_worst({"passive": SimpleNamespace(crossings=[])}) == {"passive": None}


# --- The scenario -----------------------------------------------------------------------


def run(options):
    execute(options)
    return json.loads((options.output / "summary.json").read_text())


def test_the_scenario(make_options, ssv, capsys):
    """A run-up of 6 s through the suspension: its worst crossing in both runs, as the closed form has it."""
    speeds = {"initial_speed": 260.0 * RPM, "final_speed": 380.0 * RPM, "ramp_duration": 6.0}
    given = ssv({f"disturbance.wheel_1.{name}": value for name, value in speeds.items()})
    options = make_options("wheels", 6.0, step_s=2e-4, seed=2, figures=True, parameters=(given,))
    summary = run(options)
    assert summary["warnings"] == []
    text = " ".join(capsys.readouterr().out.split())
    for case in ("passive", "active"):
        worst, largest = summary["worst_crossing"][case], summary["largest_rotation"][case]
        assert worst["wheel"] == "wheel_1" and worst["mode"].startswith("fine legs")
        assert worst["harmonic"] == 1.0
        assert worst["frequency_hz"] == pytest.approx(worst["harmonic"] * worst["speed_rpm"] / 60.0)
        assert 0.1 < worst["peak_amplitude_rad"] / worst["constant_speed_amplitude_rad"] < 0.9
        assert worst["peak_amplitude_rad"] < largest["rotation_rad"] < 3.0 * worst["peak_amplitude_rad"]
        assert worst["time_s"] - 1.0 < largest["time_s"] <= 6.0
        assert f"Worst crossing, {case}: wheel_1, harmonic 1 at" in text
    assert summary["rms_passive_rad"][1] > summary["rms_active_rad"][1] > 0.0
    names = {path.name for path in options.output.iterdir()}
    assert {"waterfall.png", "spectra.png", "report.html", "results.nc"} <= names
    page = (options.output / "report.html").read_text()
    assert "Reaction wheels: wheel_1 from 260 to 380 rpm" in page and 'class="waterfall"' in page
    assert page.index("Worst crossing, passive") < page.index("Jitter of the payload")


def test_the_product_has_profiles_for_it(make_options, steps_in_c):
    """Constant speed and a zero crossing, as the parameter files say."""
    folder = find_product().system / "parameters"
    constant = run(make_options("wheels", 0.1, step_s=2e-4, parameters=(folder / "wheels_constant.ssv",)))
    assert constant["worst_crossing"] == {"passive": None, "active": None}
    options = make_options("wheels", 0.1, step_s=2e-4, parameters=(folder / "wheels_zero_crossing.ssv",))
    run(options)
    assert "wheel_1 from -3000 to" in (options.output / "report.html").read_text()


def test_a_profile_from_a_file(make_options, ssv, tmp_path):
    speeds = tmp_path / "speed.csv"
    speeds.write_text("time [s],speed [rpm]\n0,4000\n0.2,5000\n")
    values = {"disturbance.wheel_1.enabled": False, "disturbance.wheel_3.enabled": True}
    given = ssv({**values, "disturbance.wheel_3.speed_profile": str(speeds)})
    options = make_options("wheels", 0.2, step_s=2e-4, parameters=(given,))
    run(options)
    assert "Reaction wheels: wheel_3 from 4000 to 5000 rpm" in (options.output / "report.html").read_text()
    speeds.write_text("time [s],speed [rpm]\n0,4000\n0.2,fast\n")
    with pytest.raises(OptionError, match=r"disturbance\.wheel_3\.speed_profile: speed\.csv, line 3: .*'fast'"):
        run(replace(options, output=tmp_path).claim_output())


def test_what_the_scenario_cannot_run(make_options, ssv):
    off = ssv({"disturbance.wheel_1.enabled": False})
    with pytest.raises(OptionError, match="needs a wheel that is on"):
        run(make_options("wheels", 0.1, step_s=2e-4, parameters=(off,)))
    with pytest.raises(OptionError, match="--duration: expected 16 steps at least, got 5"):
        run(make_options("wheels", 5e-4))
