"""A wheel at constant speed: the closed form of its lines, and natural modes by name."""

from dataclasses import replace

import numpy as np
import pytest
from support.cosim import Collect

from ps_fmu.control.feedforward import Controller
from ps_fmu.cosim import Master, read_system
from ps_fmu.disturbance import default_settings
from ps_fmu.disturbance.kinds.wheels import SpeedProfile, WheelSource
from ps_fmu.interface.parameter_sets import build_plant_and_isolator
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import replace_values
from ps_fmu.numerics.normal import Stream, make_key
from ps_fmu.product.files import find_product
from ps_fmu.theory.loop import loop_at, loop_of
from ps_fmu.theory.natural_modes import find_natural_modes
from ps_fmu.theory.sampled_lines import from_wrench_stepped
from ps_fmu.theory.transmissibility import from_wrench

STEP, SPEED = 1e-4, 2.0 * np.pi * 40.0  # s, rad/s
RISE, WINDOW = 1.0, 1.0  # s
DELAY = 5 * STEP
QUANTITY = [f"plant.payload_rotation.{axis}" for axis in "xyz"]


@pytest.fixture(scope="module", params=["passive", "active", "active, delayed"])
def lines(request, built_fmus):
    """Amplitudes (lines, 3) found in a run of the FMUs and in closed form, and frequencies (lines,), Hz."""
    active, delay = request.param != "passive", DELAY if "delayed" in request.param else 0.0
    values = {
        "disturbance.noise.enabled": False, "disturbance.wheel_1.enabled": True, "disturbance.rise_time": RISE,
        "disturbance.wheel_1.initial_speed": SPEED, "disturbance.wheel_1.final_speed": SPEED,
        "isolator.enabled": active, "isolator.delay": delay,
    }  # fmt: skip
    system = read_system(find_product().system / "SystemStructure.ssd", built_fmus).with_parameters(values)
    kept = Collect()
    with Master(system, STEP) as master:
        master.initialise()
        names = [column.name for column in master.columns]
        master.run(RISE + 1.0 + WINDOW, [kept])
    rows = slice(round((RISE + 1.0) / STEP), None)
    rotation = kept.values[rows][:, [names.index(name) for name in QUANTITY]]
    wheel = make_wheel()
    frequency, place = np.unique(wheel.orders * SPEED / (2.0 * np.pi), return_inverse=True)
    plant, isolator = build_plant_and_isolator(system)
    loop = loop_of(plant, isolator, (0.0, 0.0, 0.0), 0.0)
    controller = loop.controller if active else None
    G = from_wrench_stepped(loop.model, controller, frequency, STEP, delay=delay)
    expected = np.zeros((len(frequency), 3), dtype=complex)
    np.add.at(expected, place, np.einsum("nij,nj->ni", G[place], wheel.amplitudes(SPEED)))
    time = (rows.start + np.arange(len(rotation))) * STEP
    return fit_lines(time, rotation, frequency), expected, frequency


def make_wheel():
    """The first wheel of the disturbance source at the speed of the run."""
    settings = replace_values(default_settings(load()), {"seed": 1})
    wheel = settings.kinds["wheels"][0]
    key = make_key(Stream.WHEEL, settings.seed, 1)
    return WheelSource(SpeedProfile(SPEED, SPEED, 0.0, 0.0), wheel.spin_axis_B, wheel.position_B, key)


def fit_lines(time, signal, frequency):
    """Complex amplitudes (lines, signals) by least squares, with a slow parabola, in a window with soft ends."""
    turning = np.exp(2j * np.pi * np.multiply.outer(time, frequency))
    slow = np.vander(time - time.mean(), 3)
    window = np.hanning(len(time))[:, None] ** 2
    basis = np.hstack([turning.real, -turning.imag, slow])
    found = np.linalg.lstsq(basis * window, signal * window, rcond=None)[0]
    return found[: len(frequency)] + 1j * found[len(frequency) : 2 * len(frequency)]


def test_the_lines_of_a_wheel_at_constant_speed_are_those_of_the_closed_form(lines):
    """Amplitude and phase of each harmonic.

    What is left is the motion that the fade-in leaves, slow against the window, and rounding: 1e-8 of the largest line.
    """
    found, expected, frequency = lines
    assert len(frequency) == 21
    largest = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * largest)
    strong = np.abs(expected) > 1e-4 * largest
    assert strong.sum() > 20
    np.testing.assert_allclose(found[strong], expected[strong], rtol=1e-4)


def test_for_short_steps_it_is_the_continuous_closed_form():
    """Passive: the wrench is held over a step, which is half a step late and sin(x) / x of x = pi f h."""
    loop = loop_at(load())
    frequency, h = np.array([3.0, 40.0, 300.0]), 1e-5
    continuous = from_wrench(loop, 2j * np.pi * frequency, active=False)
    held = np.sinc(frequency * h) * np.exp(-1j * np.pi * frequency * h)
    found = from_wrench_stepped(loop.model, None, frequency, h)
    for k in range(len(frequency)):
        size = np.abs(continuous[k]).max()
        np.testing.assert_allclose(found[k], held[k] * continuous[k], rtol=0.0, atol=1e-4 * size)


def test_an_isolator_without_gains_is_one_that_is_off():
    loop = loop_at(load())
    g = loop.controller.gains
    nothing = type(g)(0.0 * g.acceleration, 0.0 * g.velocity, 0.0 * g.displacement)
    idle = Controller(nothing, loop.controller.lowpass, loop.controller.filters)
    frequency = np.array([1.0, 100.0])
    np.testing.assert_allclose(
        from_wrench_stepped(loop.model, idle, frequency, STEP), from_wrench_stepped(loop.model, None, frequency, STEP),
        rtol=1e-12,
    )  # fmt: skip


def test_modes_are_named_by_what_deforms():
    p = load()
    modes = find_natural_modes(loop_at(p).model.dynamics)
    names = [mode.name for mode in modes]
    assert len(set(names)) == len(names)
    assert [name.rsplit(" ", 1)[0] for name in names[6:9]] == ["fine legs"] * 3
    assert {name.split(" ")[0] for name in names[:6]} == {"bus"}
    poles = loop_at(p).plant_poles()
    poles = poles[(poles.imag > 0.0) & (np.abs(poles) > 0.1)]
    servo = 2.0 * np.pi * p.servo.frequency
    expected = sorted(np.abs(poles[~np.isclose(np.abs(poles), servo)]) / (2.0 * np.pi))
    np.testing.assert_allclose([mode.frequency for mode in modes], expected, rtol=1e-9)
    assert all(0.004 < mode.damping_ratio < 0.1 for mode in modes)


def test_a_softer_truss_is_a_mode_of_its_own_name():
    p = load()
    modes = find_natural_modes(loop_at(p).model.dynamics)
    truss = [mode for mode in modes if mode.name.startswith("truss")]
    softer = replace(p, payload=replace(p.payload, truss_modes=tuple(
        replace(mode, frequency=0.8 * mode.frequency) for mode in p.payload.truss_modes
    )))  # fmt: skip
    changed = [mode for mode in find_natural_modes(loop_at(softer).model.dynamics) if mode.name.startswith("truss")]
    assert truss and changed
    assert changed[0].frequency < truss[0].frequency
