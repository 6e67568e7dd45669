"""Wheels, sines, sweeps, their sum, and the parameters of all kinds."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from support.claims import verify_claim

from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.disturbance.tones import Chirp, Tone
from ps_fmu.disturbance.total import KINDS
from ps_fmu.disturbance.wheels import (
    FORCE,
    TORQUE,
    Harmonics,
    SpeedProfile,
    WheelSource,
)
from ps_fmu.mechanism.parameters import ParameterError, load
from ps_fmu.mechanism.quantities import list_entries, replace_values

NOTHING = Harmonics(np.array([1.0]), np.array([0.0]))
DEFAULTS = default_settings(load())
QUIET = replace_values(DEFAULTS, {"noise.enabled": False})
STEP = 1e-4  # s


# --- Wheels -----------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [300.0, -300.0])  # rad/s
def test_wheel_amplitude_and_frequency_at_constant_speed(speed):
    order, coefficient = 2.0, 1e-7  # 1, N/(rad/s)^2
    harmonic = Harmonics(np.array([order]), np.array([coefficient]))
    axis, position = np.array([1.0, 2.0, -0.5]), np.array([0.1, 0.4, -2.0])
    wheel = WheelSource(
        SpeedProfile(speed, speed, 0.0, 0.0), axis, position, (1, 2), force=harmonic, torque=NOTHING
    )
    times = 5.0 + np.arange(2000) * STEP
    force, torque = np.split(wheel(times), 2, axis=1)
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), coefficient * speed**2)
    np.testing.assert_allclose(force @ axis, 0.0, atol=1e-12)
    np.testing.assert_allclose(torque, np.cross(position, force))
    # It turns with the wheel, right-handed about the spin axis: the axis of the turn from one sample to the next.
    turn = np.cross(force[:-1], force[1:]) @ axis / np.linalg.norm(axis) / (coefficient * speed**2) ** 2
    np.testing.assert_allclose(turn, np.sin(order * speed * STEP))


@pytest.mark.parametrize("duration", [4.0, 0.0])
def test_wheel_angle_is_the_integral_of_the_speed(duration):
    profile = SpeedProfile(initial=50.0, final=-200.0, start=3.0, duration=duration)
    times = np.arange(100_001) * STEP
    speed = profile.speed(times)
    assert speed[0] == 50.0 and speed[-1] == -200.0
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * STEP)])
    np.testing.assert_allclose(profile.angle(times), integral, atol=0.02)
    steps = np.diff(profile.angle(times))
    assert np.abs(steps).max() <= 200.0 * STEP * (1.0 + 1e-6)  # continuous


def test_wheels_start_from_rest_and_leave_no_momentum():
    wheel = WheelSource(
        SpeedProfile(200.0, 200.0, 0.0, 0.0), np.array([0.0, 1.0, 0.0]), np.zeros(3), (7,), rise_time=2.0
    )
    wrench = wheel(np.arange(120_000) * STEP)
    assert not wrench[0].any()
    velocity = np.cumsum(wrench, axis=0) * STEP
    swing = np.abs(velocity).max(axis=0)[[0, 2, 3, 5]]
    turns = round(100 * 2.0 * np.pi / 200.0 / STEP)  # 100 turns: a whole number of cycles of every harmonic
    assert (np.abs(velocity[-turns:].mean(axis=0))[[0, 2, 3, 5]] < 1e-3 * swing).all()


@pytest.mark.parametrize("initial", [0.0, -300.0])
def test_a_run_up_to_6000_rpm_leaves_no_momentum(initial):
    """A free body of 1 kg stays where an unbalance on a circle puts it: within C/h^2 of each harmonic, for ever."""
    profile = SpeedProfile(initial, 628.3, start=1.0, duration=10.0)  # rad/s, s
    orders, coefficients = np.array([0.5, 1.0, 2.0]), np.array([1e-7, 2e-7, 5e-8])
    wheel = WheelSource(
        profile, np.array([0.0, 0.0, 1.0]), np.zeros(3), (5,), force=Harmonics(orders, coefficients), torque=NOTHING
    )
    times = np.arange(130_001) * STEP
    force = wheel(times)[:, :2]
    velocity = np.vstack([[0.0, 0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * STEP, axis=0)])
    position = np.cumsum(velocity, axis=0) * STEP
    largest = (coefficients / orders**2).sum()
    assert np.abs(position).max() <= 1.01 * largest
    # The last second begins and ends at full speed: the mean velocity is that of whole turns.
    assert np.abs(velocity[-10_000:].mean(axis=0)).max() < 0.01 * np.abs(velocity).max()


def test_amplitudes_at_constant_speed_are_those_of_the_wrench():
    axis, position = np.array([1.0, 2.0, 0.5]), np.array([0.1, 0.0, -1.0])
    wheel = WheelSource(SpeedProfile(-150.0, -150.0, 0.0, 0.0), axis, position, (3,))
    times = 5.0 + np.arange(200) * STEP
    turning = np.exp(1j * np.multiply.outer(-150.0 * times, wheel.orders))
    np.testing.assert_allclose((turning @ wheel.amplitudes(-150.0)).real, wheel(times), atol=1e-12)


def test_an_imbalance_is_the_force_of_a_mass_on_a_circle():
    """F = U w^2 and M = D w^2 by hand, of a wheel at the origin that turns about z and has no other harmonics."""
    U, D, speed = 0.3e-5, 2e-7, 314.0  # kg.m of 0.3 g.cm, kg.m2 of 2 g.cm2, rad/s
    (wheel,) = make_wheels({"static_imbalance": U, "dynamic_imbalance": D}, NO_HARMONICS, speed)
    times = 5.0 + np.arange(2000) * STEP
    force, torque = np.split(wheel(times), 2, axis=1)
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), U * speed**2, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(torque, axis=1), D * speed**2, rtol=1e-12)
    angle = np.unwrap(np.arctan2(force[:, 1], force[:, 0]))
    np.testing.assert_allclose(np.diff(angle), speed * STEP, rtol=1e-9)
    verify_claim(
        "wheel.imbalance",
        claim="Force and torque of a wheel with given static and dynamic imbalance",
        where="`static_imbalance` and `dynamic_imbalance` of wheels",
        reference="F = U w^2 and M = D w^2, by hand",
        error=max(abs(np.linalg.norm(force, axis=1) / (U * speed**2) - 1.0).max(),
                  abs(np.linalg.norm(torque, axis=1) / (D * speed**2) - 1.0).max()),
        bound=1e-12,
    )  # fmt: skip


NO_HARMONICS = "order [1],force [1]\n2,0\n"


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def make_wheels(own, harmonics, speed):
    """Sources of one wheel along z at the origin, with a file of harmonics in the working directory."""
    Path("wheel.csv").write_text(harmonics)
    place = {"spin_axis.x": 0.0, "spin_axis.z": 1.0, "position.z": 0.0, "initial_speed": speed, "final_speed": speed}
    values = {"enabled": True, "harmonics": "wheel.csv", **place, **own}
    settings = replace_values(QUIET, {f"wheel_1.{name}": value for name, value in values.items()})
    return [kind.make_source(settings, n) for name, n, kind in settings.list_disturbances() if name == "wheel_1"]


@pytest.mark.parametrize(
    ("header", "row", "force", "torque"),
    [
        ("order [1],force [kg.m],torque [kg.m2]", "2,3e-6,4e-7", 3e-6, 4e-7),
        ("torque [g.cm2],order [1],force [g.cm],note", "4,2,0.3,bearing", 3e-6, 4e-7),
        ("order [1],force [N/(rad/s)^2],torque [N.m/(rad/s)2]", "2,3e-6,4e-7", 3e-6, 4e-7),
        ("order [1],force [N/rpm2],torque [N.m/rpm2]", "2,1e-8,1e-9", 1e-8 / 0.1047197551**2, 1e-9 / 0.1047197551**2),
        ("order [1],force [1],torque [1]", "2,0.5,0.25", 0.5 * 6e-6, 0.25 * 8e-7),  # of the imbalance
        ("order [1],force [g.mm]", "2,3", 3e-6, 0.0),
    ],
)
def test_harmonics_in_the_units_of_a_file(header, row, force, torque):
    own = {"static_imbalance": 6e-6, "dynamic_imbalance": 8e-7}
    (wheel,) = make_wheels(own, f"{header}\n{row}\n", 100.0)
    for harmonics, expected, first in ((wheel.force, force, 0), (wheel.torque, torque, wheel.force.orders.size)):
        places = np.flatnonzero(harmonics.orders == 2.0)
        assert len(places) == (expected > 0.0)
        for place in places:  # a vector that turns: as large along x as along y
            found = np.linalg.norm(wheel.amplitudes(100.0)[first + place])
            assert found == pytest.approx(np.sqrt(2.0) * expected * 1e4, rel=1e-9)


def test_the_default_wheel():
    """A Honeywell HR16, with the proportions of the measured wheel: 3.7 % of the force at order 14.5."""
    assert FORCE.orders.size == TORQUE.orders.size == 12
    assert (FORCE.orders[0], FORCE.coefficients[0], TORQUE.coefficients[0]) == (1.0, 4.8e-6, 1.54e-6)
    assert FORCE.coefficients[FORCE.orders == 14.5] == pytest.approx(4.8e-6 * 8.10e-9 / 2.18e-7, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("order [1],force [g.cm]\n2\n", "line 2: expected 2 numbers"),
        ("order [1],force [g.cm]\n2,x\n", "line 2: expected 2 numbers"),
        ("order [1],force [g.cm]\n2,nan\n", "line 2: expected an order above 0 and coefficients of 0"),
        ("order [1],force [g.cm]\n\n-2,1e-7\n", "line 3: expected an order above 0"),
        ("2,1e-7\n", r"line 1: expected the columns 'order \[1\]'"),
        ("order [1],force [lb.in]\n2,1\n", r"line 1: force \[lb.in\]: expected one of the units kg.m, g.cm"),
        ("order [1],force [g.cm]\n1.01,0.2\n", "wheel.csv states order 1.01, which is the imbalance, too: set st"),
        ("order [1],force [g.cm]\n" + "2,1\n" * 1001, "more than 1000 harmonics"),
    ],
)
def test_harmonics_that_cannot_be_used(text, problem):
    with pytest.raises(ParameterError, match=problem):
        make_wheels({}, text, 100.0)
    with pytest.raises(ParameterError, match="harmonics: no file"):
        make_wheels({"harmonics": "missing.csv"}, text, 100.0)


def test_any_number_of_wheels_and_sines():
    """What has no parameters of its own acts as if it had."""
    times = np.arange(20_000, 21_000) * STEP
    wheel = {"enabled": True, "initial_speed": 150.0, "final_speed": 150.0, "static_imbalance": 1e-5}
    own = Disturbance(replace_values(QUIET, {f"wheel_1.{name}": value for name, value in wheel.items()}))(times)
    more = replace_values(QUIET, {"more_wheels": json.dumps([wheel, wheel])})
    assert [name for name, _, _ in more.list_disturbances() if name.startswith("wheel")][-2:] == ["wheel_5", "wheel_6"]
    found = Disturbance(replace_values(QUIET, {"more_wheels": json.dumps([wheel])}))(times)
    assert np.sqrt(np.mean(found**2)) == pytest.approx(np.sqrt(np.mean(own**2)), rel=0.02)  # other phases
    tone = {"frequency": 52.0, "force.z": 0.1}
    tones = Disturbance(replace_values(QUIET, {"more_tones": json.dumps([tone] * 20)}))(times)
    one = Disturbance(replace_values(QUIET, {f"tone_2.{name}": value for name, value in tone.items()}))(times)
    np.testing.assert_allclose(tones, 20.0 * one, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[", "more_wheels: expected a JSON list of objects"),
        ("{}", "more_wheels: expected a JSON list of objects, got '{}'"),
        ('[{"stifness": 1}]', "more_wheels: wheel_5.stifness: no such parameter"),
        ('[{}, {"scale": -1}]', "more_wheels: wheel_6.scale: must not be less than 0"),
        ('[{"harmonics": 3}]', "more_wheels: wheel_5.harmonics: expected text, got 3"),
        (json.dumps([{}] * 1001), "more_wheels: 1001 are too many"),
    ],
)
def test_further_wheels_that_cannot_be(text, problem):
    with pytest.raises(ParameterError, match=problem):
        replace_values(QUIET, {"more_wheels": text})


# --- Sines and sweeps -------------------------------------------------------------------


@pytest.mark.parametrize("frequency", [0.05, 1.0, 40.0])
def test_tone_is_a_sine_that_does_not_push_a_free_body_away(frequency):
    amplitude = np.array([1.0, 0.0, -2.0, 0.0, 0.5, 0.0])
    tone, period = Tone(amplitude, frequency, phase=0.7), 1.0 / frequency
    step = period / 200
    rise = max(2.0, period)
    times = np.arange(round((rise + 2.0 * period) / step) + 1) * step
    wrench = tone(times)
    risen = times >= rise
    expected = np.outer(np.sin(2.0 * np.pi * frequency * times[risen] + 0.7), amplitude)
    np.testing.assert_allclose(wrench[risen], expected, atol=1e-9)
    velocity = np.cumsum(wrench, axis=0) * step
    drift = velocity[-400:].mean(axis=0)  # over two periods
    assert (np.abs(drift) < 1e-3 * period).all()  # m/s for 1 kg; the swing is period / (2 pi)
    assert not wrench[0].any()


@pytest.mark.parametrize(("logarithmic", "final"), [(False, 30.0), (True, 30.0), (True, 2.0), (True, 0.5)])
def test_chirp_phase_is_the_integral_of_its_frequency(logarithmic, final):
    chirp = Chirp(np.ones(6), 2.0, final, start=1.0, duration=10.0, logarithmic=logarithmic, rise_time=0.5)
    elapsed = np.linspace(0.0, 10.0, 20_001)
    part = elapsed / 10.0
    frequency = 2.0 * (final / 2.0) ** part if logarithmic else 2.0 + (final - 2.0) * part
    turns = cumulative_simpson(frequency, x=elapsed, initial=0.0)
    risen = (elapsed > 0.5) & (elapsed < 9.5)
    expected = np.sin(2.0 * np.pi * turns[risen])
    np.testing.assert_allclose(chirp(1.0 + elapsed[risen])[:, 0], expected, rtol=0.0, atol=1e-9)
    wrench = chirp(np.array([0.0, 1.0, 11.0, 12.0]))
    assert not wrench.any()  # nothing before, at the ends, after
    inside = chirp(np.linspace(2.0, 10.0, 5001))
    assert 0.99 < np.abs(inside).max() <= 1.0


# --- Sum and parameters -----------------------------------------------------------------


def test_the_sum_of_all_kinds():
    changes = {
        "noise": {"noise.enabled": True},
        "wheel": {"wheel_3.enabled": True, "wheel_3.final_speed": 300.0, "wheel_3.ramp_duration": 5.0},
        "tone": {"tone_2.force.x": 0.3, "tone_2.torque.z": 0.1, "tone_2.frequency": 7.0},
        "chirp": {"chirp.torque.y": 1.0},
    }
    times = np.arange(0, 100_000, 17) * STEP
    parts = [Disturbance(replace_values(QUIET, change))(times) for change in changes.values()]
    everything = replace_values(QUIET, {name: value for change in changes.values() for name, value in change.items()})
    np.testing.assert_allclose(Disturbance(everything)(times), sum(parts), atol=1e-12)
    assert all(part.any() for part in parts)
    assert not Disturbance(QUIET)(times).any()
    assert Disturbance(everything)(times[:0]).shape == (0, 6)


def test_noise_acts_at_the_centre_of_mass():
    """A wrench of force alone there has the torque com x force about the origin."""
    psd = {f"noise.wrench_psd.{row}_{column}": 0.0 for row, column in _pairs() if "t" in row + column}
    settings = replace_values(DEFAULTS, psd | {"bus.com.x": 0.5, "bus.com.y": -0.3})
    wrench = Disturbance(settings)(np.arange(30_000, 31_000) * STEP)
    np.testing.assert_allclose(wrench[:, 3:], np.cross([0.5, -0.3, -2.0], wrench[:, :3]), atol=1e-9)


def _pairs():
    axes = ("fx", "fy", "fz", "tx", "ty", "tz")
    return [(axes[i], axes[j]) for i in range(6) for j in range(i, 6)]


def test_equal_wheels_have_phases_of_their_own():
    axis = {f"wheel_2.spin_axis.{a}": value for a, value in zip("xyz", (1.0, 0.0, 0.0), strict=True)}
    times = 5.0 + np.arange(1000) * STEP
    one, other = (Disturbance(replace_values(QUIET, {f"wheel_{i}.enabled": True} | axis))(times) for i in (1, 2))
    assert np.abs(one - other).max() > 0.1 * np.abs(one).max()


@pytest.mark.parametrize(
    ("changes", "step", "text"),
    [
        ({"wheel_2.enabled": True, "wheel_2.final_speed": 628.3}, 1e-3,
         r"wheel_2: harmonic 14\.88 of 628\.3 rad/s at 1488 Hz is above half the rate of steps of 0\.001 s: "),
        ({"tone_3.force.y": 1.0, "tone_3.frequency": 700.0}, 1e-3,
         r"tone_3: the sine at 700 Hz is above .*: it acts at 300 Hz instead; take steps below 0\.00071 s"),
        ({"chirp.torque.x": 1.0, "chirp.final_frequency": 30.0}, 2e-2, r"chirp: the sweep's higher end at 30 Hz"),
    ],
)  # fmt: skip
def test_lines_above_half_the_step_rate_are_named(changes, step, text):
    settings = replace_values(QUIET, changes)
    (found,) = Disturbance(settings).explain_aliasing(step)
    assert re.match(text, found), found
    assert Disturbance(settings).explain_aliasing(1e-4) == []
    # What is switched off does not fold.
    off = {name: 0.0 if isinstance(value, float) else False for name, value in changes.items() if "speed" not in name}
    off = {name: value for name, value in off.items() if "frequency" not in name}
    assert Disturbance(replace_values(settings, off)).explain_aliasing(step) == []


def test_where_a_line_folds_to():
    """The text names the frequency of the largest line of the samples."""
    step, off, folded = 1e-3, [], 0
    times = 3.0 + np.arange(4096) * step
    window = np.hanning(len(times))
    for frequency in np.random.default_rng(1).uniform(300.0, 2700.0, 24):
        settings = replace_values(QUIET, {"tone_3.force.y": 1.0, "tone_3.frequency": float(frequency)})
        spectrum = np.abs(np.fft.rfft(window * Disturbance(settings)(times)[:, 1], 2**16))
        acts = np.fft.rfftfreq(2**16, step)[spectrum.argmax()]
        texts = Disturbance(settings).explain_aliasing(step)
        folded += bool(texts)
        said = float(re.search(r"it acts at ([\d.]+) Hz", texts[0])[1]) if texts else frequency
        off.append(abs(said - acts))
    assert 12 < folded < 24
    verify_claim(
        "warning.folding",
        claim="... is above half the rate of steps: it acts at ... Hz instead; or no such warning",
        where="`ps-fmu run` with wheels, sines and sweeps: terminal, report, `warnings` of summary.json",
        reference="largest line of the Fourier transform of the samples, 24 sines from 300 to 2700 Hz at steps of 1 ms",
        error=max(off),
        bound=0.02,
        unit="Hz",
    )


def test_scale_and_seed():
    times = np.arange(30_000, 30_100) * STEP
    one = Disturbance(DEFAULTS)(times)
    np.testing.assert_allclose(Disturbance(replace_values(DEFAULTS, {"noise.scale": 3.0}))(times), 3.0 * one)
    assert not np.allclose(Disturbance(replace_values(DEFAULTS, {"seed": 2}))(times), one)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seed", -1), ("seed", 1.5), ("rise_time", 0.0), ("rise_time", 21.0), ("bus.com.x", np.nan),
        ("noise.band.max", 0.05), ("noise.band.max", 5000.0), ("noise.scale", -1.0), ("noise.period", 10.0),
        ("noise.period", 2000.0), ("noise.wrench_psd.fx_fx", -1.0), ("wheel_2.ramp_duration", -1.0),
        ("wheel_1.spin_axis.x", 0.0), ("tone_1.frequency", 0.0), ("chirp.initial_frequency", 0.0),
        ("noise.multisine", 2),
    ],
)  # fmt: skip
def test_impossible_parameters_are_named(name, value):
    with pytest.raises(ParameterError) as refusal:
        replace_values(DEFAULTS, {name: value})
    assert name.startswith(refusal.value.name) or refusal.value.name == name


def test_a_sweep_too_short_for_its_fades():
    with pytest.raises(ParameterError, match=r"chirp.duration: must be at least twice the rise_time"):
        replace_values(DEFAULTS, {"chirp.force.x": 1.0, "chirp.duration": 3.0})


def test_every_number_has_a_unit_and_a_description():
    for entry in list_entries(DEFAULTS):
        assert entry.description, entry.name
        assert entry.unit or isinstance(entry.value, (bool, str)), entry.name


def test_each_kind_has_its_section_in_the_readme():
    readme = Path(__file__).parents[2] / "fmus" / "disturbance_source" / "README.md"
    headings = [line for line in readme.read_text(encoding="utf-8").splitlines() if line.startswith("## ")]
    for kind in KINDS:
        several = isinstance(DEFAULTS.kinds[kind.name], tuple)
        name = f"`{kind.name.removesuffix('s')}_i`" if several else f"`{kind.name}`"
        assert any(name in heading for heading in headings), name
